//! Functions and publishers of Wrapyfi, told from the ports of robots.
//!
//! ```text
//!   /wf/fn    subscribe /wf/fn ─▶ /wf/fn:out     Python Wrapyfi: JSON in one string
//!             property wrapyfi = json            ours: JSON, too
//!   /rpc:i    neither                            a robot: bottles, whose strings are strings
//! ```
//!
//! On the wire both are rpc ports, or send bottles of one string, and no program may be asked: a robot carries out what
//! it is sent, and Wrapyfi calls its function. The name server knows, though: a server or publisher of Wrapyfi asks it
//! for a connection from its port to the same name with `:out`, and ours leave a property.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use wrapyfi_yarp::wire::admin::split_destination;

use super::options::{BottleFormat, YarpOptions};
use super::shared::InstanceState;
use wrapyfi_data::types::{DataType, MessageType};
use wrapyfi_endpoint::Mutex;

/// Property of a port of ours at the name server, where it takes calls as Wrapyfi's.
const MARK: &str = "wrapyfi";
/// Value of [`MARK`].
const JSON: &str = "json";
/// Most ports whose format a listener keeps.
const MOST_SENDERS: usize = 256;
/// Time that Wrapyfi is given between opening its port and asking for that connection.
const OPENS_WITHIN: Duration = Duration::from_millis(250);

/// BottleFormat in which the server behind the port `name` reads calls: JSON where Wrapyfi opened it, else
/// bottles.
pub(super) async fn of_server(
    shared: &InstanceState,
    name: &str,
    has_just_come: bool,
) -> BottleFormat {
    if is_of_wrapyfi(shared, name).await {
        return BottleFormat::Json;
    }
    if has_just_come {
        tokio::time::sleep(OPENS_WITHIN).await;
        if is_of_wrapyfi(shared, name).await {
            return BottleFormat::Json;
        }
    }
    BottleFormat::Bottle
}

/// Formats in which the programs that send to a listener write native objects. Each port is looked up once, with its
/// first message: Wrapyfi has asked for its connection by then.
#[derive(Debug, Default)]
pub(super) struct SenderFormats {
    /// Options with JSON and with bottles, where the topic leaves the format to be found.
    found: Option<[Arc<YarpOptions>; 2]>,
    /// Ports by name, with the number of their entry in the directory, and whether they write JSON.
    known: Mutex<BTreeMap<String, (u64, bool)>>,
}

impl SenderFormats {
    pub(super) fn new(
        message_type: MessageType,
        options: &YarpOptions,
        shared: &InstanceState,
    ) -> Self {
        let is_object = matches!(message_type, MessageType::NativeObject | MessageType::StringJson);
        let finds = is_object && options.bottle.is_none() && !shared.is_wrapyfi;
        let of = |format| Arc::new(YarpOptions { bottle: Some(format), ..options.clone() });
        let found = finds.then(|| [BottleFormat::Json, BottleFormat::Plain].map(of));
        Self { found, known: Mutex::default() }
    }

    /// Options for what the port `name` sends; `None` where they are the listener's.
    pub(super) async fn of(&self, shared: &InstanceState, name: &str) -> Option<Arc<YarpOptions>> {
        let [json, plain] = self.found.as_ref()?;
        let with = |is_json| Some(Arc::clone(if is_json { json } else { plain }));
        let number = shared.directory.entry(name).map_or(0, |entry| entry.number);
        let known = self.known.lock().get(name).copied();
        if let Some((of, is_json)) = known
            && of == number
        {
            return with(is_json);
        }
        if shared.directory.waiting_for().is_some() {
            // No program can be asked now: the next message asks again.
            return None;
        }
        let is_json = name.starts_with('/') && is_of_wrapyfi(shared, name).await;
        let mut known = self.known.lock();
        if known.len() >= MOST_SENDERS {
            known.clear();
        }
        known.insert(name.to_owned(), (number, is_json));
        with(is_json)
    }
}

/// True where a publisher writes native objects as Wrapyfi does, to the program that reads them.
pub(super) fn writes_json(message_type: MessageType, options: &YarpOptions) -> bool {
    let is_json = matches!(options.bottle, None | Some(BottleFormat::Json));
    is_json
        && message_type.data_type() == DataType::NativeObject
        && message_type != MessageType::Text
}

async fn is_of_wrapyfi(shared: &InstanceState, name: &str) -> bool {
    let marks = shared.network.names().get(name, MARK).await;
    if marks.is_ok_and(|marks| marks.iter().any(|mark| mark == JSON)) {
        return true;
    }
    let wishes = shared.registrar.client().subscriptions(Some(name)).await;
    wishes.is_ok_and(|wishes| wishes.iter().any(|wish| is_to_out(&wish.src, &wish.dest)))
}

/// True when `dest` is the port that Wrapyfi connects its port `src` to: the same name with `:out`.
fn is_to_out(src: &str, dest: &str) -> bool {
    let bare =
        |text: &str| split_destination(text).map_or_else(|| text.to_owned(), |(_, name)| name);
    bare(dest).strip_suffix(":out") == Some(bare(src).as_str())
}

/// Leaves the mark of a server that reads JSON.
pub(super) async fn mark(shared: &InstanceState, name: &str) {
    if let Err(error) = shared.network.names().set(name, MARK, &[JSON.to_owned()]).await {
        tracing::debug!(name, %error, "the name server does not know that this is a function of ours");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_wrapyfi_asks_the_name_server_for_is_known() {
        assert!(is_to_out("tcp://wf/fn", "tcp://wf/fn:out"));
        assert!(is_to_out("/wf/fn", "/wf/fn:out"));
        assert!(!is_to_out("/wf/fn", "/other:out") && !is_to_out("/wf/fn", "/wf/fn:in3"));
    }

    #[test]
    fn the_form_is_found_only_where_none_is_set() {
        let given = YarpOptions { finds_format: true, ..YarpOptions::default() };
        for format in [BottleFormat::Bottle, BottleFormat::Json] {
            assert_eq!(given.with_found(format).bottle, Some(format));
            let fixed = YarpOptions::default();
            assert_eq!(*fixed.with_found(format), fixed);
        }
    }
}
