//! CURVE (CurveZMQ, RFC 26): one connection that is encrypted, whose ends know each other by their keys.
//!
//! ```text
//!   client                               server            C, S: keys that stay; C', S': keys of this connection
//!     ── HELLO      C', zeros(C' → S) ─────▶
//!     ◀── WELCOME   (S', cookie)(S → C') ───
//!     ── INITIATE   cookie, (C, (C', S)(C → S'), properties)(C' → S') ──▶  is C listed?
//!     ◀── READY     (properties)(S' → C') ──   or ERROR 400
//!     ◀── MESSAGE   (flags, body)(S' ↔ C'), each with a higher number ──▶
//! ```
//!
//! Nothing is allocated by what a peer announces: commands come here whole, within the limits of their frames.

mod keys;

use std::sync::{Arc, OnceLock};

use crypto_box::aead::AeadInPlace as _;
use crypto_box::{PublicKey, SalsaBox, SecretKey};
use zeroize::{Zeroize as _, Zeroizing};

pub(crate) use keys::{Grant, Keys};

use crate::zmtp::{self, HandshakeStep, Kind, Opened};
use keys::{Key, random};

/// Bytes before the ciphertext: the command's name, a number and a seal.
const HEAD: usize = 8 + 8 + TAG;
const TAG: usize = 16;
/// Bytes that a frame grows by: these, and its flags.
pub(crate) const OVERHEAD: usize = HEAD + 1;
/// Number of bytes of a cookie: what libzmq takes.
const COOKIE: usize = 96;

const MORE: u8 = 1;
const COMMAND: u8 = 2;

/// Cause for which a connection with CURVE ends.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Breach {
    #[error("its command {0} of CURVE is malformed or not its turn")]
    Malformed(&'static str),
    #[error("its command {0} of CURVE does not open: it is made for another server key, or forged")]
    Sealed(&'static str),
    #[error("its CURVE key {0} is not among the clients of this broker (curve: clients)")]
    Unknown(String),
    #[error("its CURVE key {0} may not {1} here (curve: clients)")]
    NotAllowed(String, &'static str),
    #[error("it repeats a message of CURVE, or sends one out of turn")]
    Repeated,
    #[error("it refuses our CURVE key ({0})")]
    Refused(String),
    #[error("the system gives no random numbers for CURVE")]
    NoRandom,
}

impl Breach {
    /// Reason under which the connection is counted.
    pub(crate) fn reason(&self) -> &'static str {
        match self {
            Self::Unknown(_) => "unknown_key",
            Self::NotAllowed(..) => "not_allowed",
            _ => "curve",
        }
    }

    /// Key of the client, where that is why it ends.
    pub(crate) fn key(&self) -> Option<&str> {
        match self {
            Self::Unknown(key) | Self::NotAllowed(key, _) => Some(key),
            _ => None,
        }
    }

    /// Command that tells the client, where it is told.
    pub(crate) fn farewell(&self) -> Option<&'static [u8]> {
        matches!(self, Self::Unknown(_) | Self::NotAllowed(..)).then_some(b"\x05ERROR\x03400")
    }
}

enum Stage {
    /// As a server, before HELLO.
    Waiting(Kind),
    /// As a server, before INITIATE.
    Welcomed {
        kind: Kind,
        client: Key,
        short: Zeroizing<Key>,
        cookie: Zeroizing<[u8; COOKIE]>,
    },
    /// As a client, before WELCOME.
    Greeted(Zeroizing<Key>),
    /// As a client, before READY.
    Initiated,
    Open,
}

/// Our end of one connection.
pub(crate) struct Curve {
    keys: Arc<Keys>,
    is_server: bool,
    stage: Stage,
    /// Box between the two keys of this connection.
    session: Option<SalsaBox>,
    /// Number of the last command that we sent, and of the last that came.
    sent: u64,
    heard: u64,
    grant: Option<Arc<Grant>>,
}

impl Curve {
    /// The end of a socket of a broker.
    pub(crate) fn server(keys: &Arc<Keys>, kind: Kind) -> Self {
        Self::new(keys, true, Stage::Waiting(kind))
    }

    /// The end that connects, and its first command.
    pub(crate) fn client(keys: &Arc<Keys>) -> Result<(Self, Vec<u8>), Breach> {
        let short: Zeroizing<Key> = random().map_err(|_opaque| Breach::NoRandom)?;
        let mut hello = b"\x05HELLO\x01\0".to_vec();
        hello.resize(80, 0);
        hello.extend_from_slice(SecretKey::from(*short).public_key().as_bytes());
        hello.extend(1_u64.to_be_bytes());
        let toward = shared(&keys.server, &short)?;
        hello.extend(seal(&toward, &numbered(b"CurveZMQHELLO---", 1), &[0; 64])?);
        let mut curve = Self::new(keys, false, Stage::Greeted(short));
        curve.sent = 1;
        Ok((curve, hello))
    }

    fn new(keys: &Arc<Keys>, is_server: bool, stage: Stage) -> Self {
        let keys = Arc::clone(keys);
        Self { keys, is_server, stage, session: None, sent: 0, heard: 0, grant: None }
    }

    pub(crate) fn is_server(&self) -> bool {
        self.is_server
    }

    /// Permissions of the client; none where it may everything.
    pub(crate) fn grant(&self) -> Option<&Arc<Grant>> {
        self.grant.as_ref()
    }

    /// Takes a command of the handshake; `properties` are ours.
    ///
    /// # Errors
    /// Why the connection ends.
    pub(crate) fn handshake(
        &mut self,
        command: &[u8],
        properties: &[u8],
    ) -> Result<HandshakeStep, Breach> {
        match std::mem::replace(&mut self.stage, Stage::Open) {
            Stage::Waiting(kind) => self.hello(command, kind).map(HandshakeStep::Say),
            Stage::Welcomed { kind, client, short, cookie } => {
                let theirs = self.initiate(command, kind, &client, &short, &cookie)?;
                self.sent += 1;
                let mut ready = b"\x05READY".to_vec();
                ready.extend(self.sent.to_be_bytes());
                let nonce = numbered(b"CurveZMQREADY---", self.sent);
                ready.extend(seal(self.session()?, &nonce, properties)?);
                Ok(HandshakeStep::Open(Some(ready), theirs))
            }
            Stage::Greeted(short) => {
                self.welcome(command, &short, properties).map(HandshakeStep::Say)
            }
            Stage::Initiated => self.ready(command).map(|theirs| HandshakeStep::Open(None, theirs)),
            Stage::Open => Err(Breach::Malformed("of a second handshake")),
        }
    }

    fn session(&self) -> Result<&SalsaBox, Breach> {
        self.session.as_ref().ok_or(Breach::Malformed("MESSAGE"))
    }

    fn hello(&mut self, command: &[u8], kind: Kind) -> Result<Vec<u8>, Breach> {
        const WRONG: Breach = Breach::Malformed("HELLO");
        let rest = command.strip_prefix(b"\x05HELLO\x01\0").ok_or(WRONG)?;
        let (_padding, rest) = rest.split_first_chunk::<72>().ok_or(WRONG)?;
        let (client, rest) = rest.split_first_chunk::<32>().ok_or(WRONG)?;
        let (number, rest) = rest.split_first_chunk::<8>().ok_or(WRONG)?;
        let sealed: &[u8; 64 + TAG] = rest.try_into().map_err(|_opaque| WRONG)?;
        self.heard = u64::from_be_bytes(*number);
        let toward = shared(client, &self.keys.secret)?;
        let zeros = open(&toward, &numbered(b"CurveZMQHELLO---", self.heard), sealed)
            .ok_or(Breach::Sealed("HELLO"))?;
        if zeros.iter().any(|byte| *byte != 0) {
            return Err(WRONG);
        }
        let failed = |_| Breach::NoRandom;
        let (short, cookie) = (random().map_err(failed)?, random().map_err(failed)?);
        let mut told = Zeroizing::new(SecretKey::from(*short).public_key().as_bytes().to_vec());
        // What our connection remembers anyway need not be in it: it shows that the client could open this.
        told.extend_from_slice(&*cookie);
        let (nonce, random) = random_nonce(b"WELCOME-")?;
        let mut welcome = b"\x07WELCOME".to_vec();
        welcome.extend(random);
        welcome.extend(seal(&toward, &nonce, &told)?);
        self.session = Some(shared(client, &short)?);
        self.stage = Stage::Welcomed { kind, client: *client, short, cookie };
        Ok(welcome)
    }

    fn initiate(
        &mut self,
        command: &[u8],
        kind: Kind,
        client: &Key,
        short: &Key,
        cookie: &[u8; COOKIE],
    ) -> Result<Vec<u8>, Breach> {
        const WRONG: Breach = Breach::Malformed("INITIATE");
        let rest = command.strip_prefix(b"\x08INITIATE").ok_or(WRONG)?;
        let (theirs, rest) = rest.split_first_chunk::<COOKIE>().ok_or(WRONG)?;
        let (number, sealed) = rest.split_first_chunk::<8>().ok_or(WRONG)?;
        if theirs != cookie {
            return Err(Breach::Sealed("INITIATE"));
        }
        let nonce = numbered(b"CurveZMQINITIATE", self.next(number)?);
        let told = open(self.session()?, &nonce, sealed).ok_or(Breach::Sealed("INITIATE"))?;
        let (key, rest) = told.split_first_chunk::<32>().ok_or(WRONG)?;
        let (random, rest) = rest.split_first_chunk::<16>().ok_or(WRONG)?;
        let (vouch, properties) = rest.split_first_chunk::<{ 64 + TAG }>().ok_or(WRONG)?;
        // Only who has the secret of the key that stays can vouch with it for that of this connection.
        let vouched = open(&shared(key, short)?, &nonce_of(b"VOUCH---", random), vouch)
            .ok_or(Breach::Sealed("INITIATE"))?;
        if *vouched != [&client[..], &self.keys.public].concat() {
            return Err(Breach::Sealed("INITIATE"));
        }
        self.grant = self.keys.admit(key, kind)?;
        Ok(properties.to_vec())
    }

    fn welcome(
        &mut self,
        command: &[u8],
        short: &Key,
        properties: &[u8],
    ) -> Result<Vec<u8>, Breach> {
        const WRONG: Breach = Breach::Malformed("WELCOME");
        refusal(command)?;
        let rest = command.strip_prefix(b"\x07WELCOME").ok_or(WRONG)?;
        let (random, sealed) = rest.split_first_chunk::<16>().ok_or(WRONG)?;
        let toward = shared(&self.keys.server, short)?;
        let told = open(&toward, &nonce_of(b"WELCOME-", random), sealed)
            .ok_or(Breach::Sealed("WELCOME"))?;
        let (server, cookie) = told.split_first_chunk::<32>().ok_or(WRONG)?;
        let cookie: &[u8; COOKIE] = cookie.try_into().map_err(|_opaque| WRONG)?;

        let public = *SecretKey::from(*short).public_key().as_bytes();
        let vouched = [public, self.keys.server].concat();
        let (nonce, random) = random_nonce(b"VOUCH---")?;
        let vouch = seal(&shared(server, &self.keys.secret)?, &nonce, &vouched)?;
        let told = [&self.keys.public[..], &random, &vouch, properties].concat();

        let session = shared(server, short)?;
        self.sent += 1;
        let mut initiate = b"\x08INITIATE".to_vec();
        initiate.extend_from_slice(cookie);
        initiate.extend(self.sent.to_be_bytes());
        initiate.extend(seal(&session, &numbered(b"CurveZMQINITIATE", self.sent), &told)?);
        (self.session, self.stage) = (Some(session), Stage::Initiated);
        Ok(initiate)
    }

    fn ready(&mut self, command: &[u8]) -> Result<Vec<u8>, Breach> {
        const WRONG: Breach = Breach::Malformed("READY");
        refusal(command)?;
        let rest = command.strip_prefix(b"\x05READY").ok_or(WRONG)?;
        let (number, sealed) = rest.split_first_chunk::<8>().ok_or(WRONG)?;
        let nonce = numbered(b"CurveZMQREADY---", self.next(number)?);
        let properties = open(self.session()?, &nonce, sealed).ok_or(Breach::Sealed("READY"))?;
        Ok(properties.to_vec())
    }

    /// Number of a command that came, which is higher than that of the one before.
    fn next(&mut self, number: &[u8; 8]) -> Result<u64, Breach> {
        let number = u64::from_be_bytes(*number);
        if number <= self.heard {
            return Err(Breach::Repeated);
        }
        self.heard = number;
        Ok(number)
    }

    /// Adds a frame to `out`, sealed.
    pub(crate) fn seal(
        &mut self,
        is_command: bool,
        more: bool,
        body: &[u8],
        out: &mut Vec<u8>,
    ) -> Result<(), Breach> {
        self.sent = self.sent.checked_add(1).ok_or(Breach::Repeated)?;
        let nonce = numbered(self.prefix(self.is_server), self.sent);
        let session = self.session()?;
        out.reserve(body.len() + OVERHEAD + 9);
        zmtp::put_header(false, false, body.len() + OVERHEAD, out);
        out.extend_from_slice(b"\x07MESSAGE");
        out.extend(self.sent.to_be_bytes());
        let (seal_at, flags_at) = (out.len(), out.len() + TAG);
        out.extend([0; TAG]);
        out.push(if more { MORE } else { 0 } | if is_command { COMMAND } else { 0 });
        out.extend_from_slice(body);
        let plain = out.get_mut(flags_at..).unwrap_or_default();
        let tag = session
            .encrypt_in_place_detached(&nonce.into(), &[], plain)
            .map_err(|_opaque| Breach::Malformed("MESSAGE"))?;
        if let Some(place) = out.get_mut(seal_at..flags_at) {
            place.copy_from_slice(&tag);
        }
        Ok(())
    }

    /// Opens the body of a frame in place.
    ///
    /// # Errors
    /// When it is not of this connection, or not the next.
    pub(crate) fn open(&mut self, frame: &mut [u8]) -> Result<Opened, Breach> {
        const WRONG: Breach = Breach::Malformed("MESSAGE");
        let (head, sealed) = frame.split_at_mut_checked(HEAD).ok_or(WRONG)?;
        let rest = head.strip_prefix(b"\x07MESSAGE").ok_or(WRONG)?;
        let (number, tag) = rest.split_first_chunk::<8>().ok_or(WRONG)?;
        let tag: [u8; TAG] = tag.try_into().map_err(|_opaque| WRONG)?;
        let nonce = numbered(self.prefix(!self.is_server), self.next(number)?);
        self.session()?
            .decrypt_in_place_detached(&nonce.into(), &[], sealed, &tag.into())
            .map_err(|_opaque| Breach::Sealed("MESSAGE"))?;
        let flags = sealed.first().ok_or(WRONG)?;
        Ok(Opened { is_command: flags & COMMAND != 0, more: flags & MORE != 0 })
    }

    fn prefix(&self, of_server: bool) -> &'static [u8; 16] {
        if of_server { b"CurveZMQMESSAGES" } else { b"CurveZMQMESSAGEC" }
    }
}

/// An error where the command is one of refusal.
fn refusal(command: &[u8]) -> Result<(), Breach> {
    let Some([length, rest @ ..]) = command.strip_prefix(b"\x05ERROR") else { return Ok(()) };
    let reason = rest.get(..usize::from(*length)).unwrap_or(rest);
    Err(Breach::Refused(reason.escape_ascii().to_string()))
}

/// Box from the key of another to ours.
///
/// # Errors
/// When any other secret would lead to the same: no program has such a key.
fn shared(theirs: &Key, ours: &Key) -> Result<SalsaBox, Breach> {
    static OF_NOBODY: OnceLock<Vec<u8>> = OnceLock::new();
    let between = |theirs: Key| SalsaBox::new(&PublicKey::from(theirs), &SecretKey::from(*ours));
    let trial = |of: &SalsaBox| seal(of, &[0; 24], &[0; 16]).unwrap_or_default();
    let shared = between(*theirs);
    if trial(&shared) == *OF_NOBODY.get_or_init(|| trial(&between([0; 32]))) {
        return Err(Breach::Sealed("with a weak key"));
    }
    Ok(shared)
}

fn seal(with: &SalsaBox, nonce: &[u8; 24], plain: &[u8]) -> Result<Vec<u8>, Breach> {
    let mut sealed = vec![0; TAG];
    sealed.extend_from_slice(plain);
    let Some((place, text)) = sealed.split_first_chunk_mut::<TAG>() else { return Ok(sealed) };
    let tag = with
        .encrypt_in_place_detached(&(*nonce).into(), &[], text)
        .map_err(|_opaque| Breach::Malformed("of ours"))?;
    place.copy_from_slice(&tag);
    Ok(sealed)
}

fn open(with: &SalsaBox, nonce: &[u8; 24], sealed: &[u8]) -> Option<Zeroizing<Vec<u8>>> {
    let (tag, sealed) = sealed.split_first_chunk::<TAG>()?;
    let mut plain = Zeroizing::new(sealed.to_vec());
    let opened = with.decrypt_in_place_detached(&(*nonce).into(), &[], &mut plain, &(*tag).into());
    if opened.is_err() {
        plain.zeroize();
        return None;
    }
    Some(plain)
}

/// A nonce that ends with the number of its command.
fn numbered(prefix: &[u8; 16], number: u64) -> [u8; 24] {
    let mut nonce = [0; 24];
    for (place, byte) in nonce.iter_mut().zip(prefix.iter().copied().chain(number.to_be_bytes())) {
        *place = byte;
    }
    nonce
}

fn nonce_of(prefix: &[u8; 8], rest: &[u8; 16]) -> [u8; 24] {
    let mut nonce = [0; 24];
    for (place, byte) in nonce.iter_mut().zip(prefix.iter().chain(rest)) {
        *place = *byte;
    }
    nonce
}

/// A nonce that ends with random bytes, and these.
fn random_nonce(prefix: &[u8; 8]) -> Result<([u8; 24], [u8; 16]), Breach> {
    let rest: Zeroizing<[u8; 16]> = random().map_err(|_opaque| Breach::NoRandom)?;
    Ok((nonce_of(prefix, &rest), *rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PROPERTIES: &[u8] = b"\x0bSocket-Type\0\0\0\x03SUB";

    /// Two ends after their handshake, and the commands of it: client's, server's, in turn.
    fn talk(
        client: &Arc<Keys>,
        server: &Arc<Keys>,
    ) -> Result<(Curve, Curve, Vec<Vec<u8>>), Breach> {
        let (mut client, hello) = Curve::client(client)?;
        let mut server = Curve::server(server, Kind::Xpub);
        let mut said = vec![hello];
        for turn in 0.. {
            let to = if turn % 2 == 0 { &mut server } else { &mut client };
            match to.handshake(said.last().unwrap(), PROPERTIES)? {
                HandshakeStep::Say(command) => said.push(command),
                HandshakeStep::Open(last, theirs) => {
                    assert_eq!(theirs, PROPERTIES);
                    let Some(last) = last else { break };
                    said.push(last);
                }
            }
        }
        Ok((client, server, said))
    }

    fn keys(number: u8, server: Option<&Keys>) -> Arc<Keys> {
        Keys::of_test(number, server)
    }

    #[test]
    fn both_ends_understand_each_other() {
        let ours = keys(1, None);
        let (mut client, mut server, said) = talk(&keys(2, Some(&ours)), &ours).unwrap();
        let sizes: Vec<usize> = said.iter().map(Vec::len).collect();
        let properties = PROPERTIES.len();
        assert_eq!(sizes, [200, 168, 257 + properties, 30 + properties], "as RFC 26 has them");
        for size in [0, 1, 300, 100_000] {
            let body = vec![9; size];
            let mut wire = Vec::new();
            client.seal(false, true, &body, &mut wire).unwrap();
            let header = zmtp::header(&wire).unwrap();
            assert_eq!(header.size + header.length, wire.len());
            let frame = &mut wire[header.size..];
            let opened = server.open(frame).unwrap();
            assert!(opened.more && !opened.is_command);
            assert_eq!(frame[OVERHEAD..], body[..]);
        }
    }

    #[test]
    fn a_message_that_comes_again_ends_the_connection() {
        let ours = keys(1, None);
        let (mut client, mut server, _) = talk(&keys(2, Some(&ours)), &ours).unwrap();
        let mut frames = [Vec::new(), Vec::new()];
        for frame in &mut frames {
            client.seal(false, false, b"x", frame).unwrap();
            frame.drain(..2);
        }
        let [mut first, mut second] = frames;
        let mut again = second.clone();
        server.open(&mut second).unwrap();
        assert_eq!(server.open(&mut again).err(), Some(Breach::Repeated));
        assert_eq!(server.open(&mut first).err(), Some(Breach::Repeated), "it is late");
        let mut own = Vec::new();
        while server.sent <= server.heard {
            own.clear();
            server.seal(false, false, b"x", &mut own).unwrap();
        }
        let reflected = server.open(&mut own[2..]).err();
        assert_eq!(
            reflected,
            Some(Breach::Sealed("MESSAGE")),
            "a server's words come from no client"
        );
    }

    #[test]
    fn another_key_opens_nothing() {
        let (ours, other) = (keys(1, None), keys(3, None));
        let wrong = talk(&keys(2, Some(&other)), &ours).err();
        assert_eq!(wrong, Some(Breach::Sealed("HELLO")));
        // Points whose product with every secret is the same.
        let mut one = [0; 32];
        one[0] = 1;
        for weak in [[0; 32], one] {
            assert!(shared(&weak, &ours.secret).is_err());
        }
        assert!(shared(&other.public, &ours.secret).is_ok());
    }

    #[test]
    fn who_vouches_for_another_key_is_refused() {
        let ours = keys(1, None);
        let (mut client, hello) = Curve::client(&keys(2, Some(&ours))).unwrap();
        let mut server = Curve::server(&ours, Kind::Xpub);
        let HandshakeStep::Say(welcome) = server.handshake(&hello, PROPERTIES).unwrap() else {
            panic!()
        };
        // A client that knows only the public key of the one that it pretends to be.
        client.keys = keys(4, Some(&ours)).pretending(&keys(2, None));
        let HandshakeStep::Say(initiate) = client.handshake(&welcome, PROPERTIES).unwrap() else {
            panic!()
        };
        let refused = server.handshake(&initiate, PROPERTIES).err();
        assert_eq!(refused, Some(Breach::Sealed("INITIATE")));
    }

    #[test]
    fn a_refusal_is_understood() {
        let ours = keys(1, None);
        let (mut client, _) = Curve::client(&keys(2, Some(&ours))).unwrap();
        let told = Breach::Unknown(String::new()).farewell().unwrap();
        let refused = client.handshake(told, PROPERTIES).err();
        assert_eq!(refused, Some(Breach::Refused("400".to_owned())));
        for end in 6..told.len() {
            assert!(refusal(&told[..end]).is_err() || end == 6, "{end}");
        }
    }

    proptest! {
        /// Each command of the handshake, cut or changed anywhere, ends it and does no harm.
        #[test]
        fn commands_that_are_cut_or_changed_end_it(at in 0_usize..4, cut in 0.0..1.0_f64, bit in 0..8_u32, drop_it in any::<bool>()) {
            let ours = keys(1, None);
            let (mut client, hello) = Curve::client(&keys(2, Some(&ours))).unwrap();
            let mut server = Curve::server(&ours, Kind::Xpub);
            let mut next = hello;
            for turn in 0..4 {
                let to = if turn % 2 == 0 { &mut server } else { &mut client };
                if turn == at {
                    let place = (cut * next.len() as f64) as usize;
                    // No peer reads the padding of HELLO, nor the highest bit of a key, for which it is not vouched.
                    let is_unread = (8..80).contains(&place) || (place, bit) == (111, 7);
                    prop_assume!(drop_it || turn > 0 || !is_unread);
                    if drop_it { next.truncate(place) } else { next[place] ^= 1 << bit };
                    prop_assert!(to.handshake(&next, PROPERTIES).is_err(), "{} {}", turn, place);
                    break;
                }
                match to.handshake(&next, PROPERTIES).unwrap() {
                    HandshakeStep::Say(command) | HandshakeStep::Open(Some(command), _) => next = command,
                    HandshakeStep::Open(None, _) => {}
                }
            }
        }

        /// Bytes of any kind, in any stage.
        #[test]
        fn foreign_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..400), name in 0_usize..7) {
            let names: [&[u8]; 7] = [b"", b"\x05HELLO\x01\0", b"\x07WELCOME", b"\x08INITIATE", b"\x05READY", b"\x07MESSAGE", b"\x05ERROR"];
            let bytes = [names[name], &bytes].concat();
            let ours = keys(1, None);
            let (mut client, hello) = Curve::client(&keys(2, Some(&ours))).unwrap();
            prop_assert!(client.handshake(&bytes, PROPERTIES).is_err());
            let mut server = Curve::server(&ours, Kind::Xpub);
            prop_assert!(server.handshake(&bytes, PROPERTIES).is_err());
            let mut server = Curve::server(&ours, Kind::Xpub);
            server.handshake(&hello, PROPERTIES).unwrap();
            prop_assert!(server.handshake(&bytes, PROPERTIES).is_err());
            let (mut client, mut server, _) = talk(&keys(2, Some(&ours)), &ours).unwrap();
            prop_assert!(server.open(&mut bytes.clone()).is_err());
            prop_assert!(client.open(&mut bytes.clone()).is_err());
        }
    }
}
