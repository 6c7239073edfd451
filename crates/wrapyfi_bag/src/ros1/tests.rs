//! Bags that are whole, cut, and wrong in every place.

use std::io::Cursor;

use proptest::prelude::*;

use super::writing::{begin, chunk, connection, message, messages, pack, packed, record};
use super::*;

const COMPRESSIONS: [&str; 3] = ["none", "bz2", "lz4"];

fn open(bag: Vec<u8>) -> BagReader<Cursor<Vec<u8>>> {
    let limits = Limits { message_bytes: 1 << 16, chunk_bytes: 1 << 20 };
    BagReader::open(Cursor::new(bag), limits).unwrap()
}

/// Numbers of the messages, and the damage.
fn read(bag: Vec<u8>) -> (Vec<u32>, Damage) {
    let mut reader = open(bag);
    let mut numbers = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        numbers.push(message.data.try_into().map_or(u32::MAX, u32::from_le_bytes));
    }
    (numbers, reader.damage().clone())
}

fn numbers(all: std::ops::Range<u32>) -> Vec<u32> {
    all.collect()
}

/// Two chunks of ten messages each, which both have the connection.
fn two_chunks(compression: &str) -> [Vec<u8>; 3] {
    let [first, second] = [0..10, 10..20].map(|numbers| {
        chunk(compression, &[connection(0, "/a", "uint32 number"), messages(numbers)].concat())
    });
    [begin(0), first, second]
}

#[test]
fn messages_come_in_order_however_they_are_packed() {
    for compression in COMPRESSIONS {
        let (found, damage) = read(two_chunks(compression).concat());
        assert_eq!(found, numbers(0..20), "{compression}");
        assert!(damage.is_none(), "{compression}: {damage}");
    }
    let mut reader = open(two_chunks("none").concat());
    let first = reader.next_message().unwrap().unwrap();
    assert_eq!((first.connection, first.time_ns), (0, 0));
    let second = reader.next_message().unwrap().unwrap();
    assert_eq!(second.time_ns, 1_000_000_000);
    let known = &reader.connections()[&0];
    assert_eq!((known.topic.as_str(), known.latching), ("/a", true));
    assert_eq!(known.definition, "uint32 number");
}

#[test]
fn a_bag_that_is_cut_before_its_first_record_ends_is_not_whole() {
    for size in [13, 14, 30, 200] {
        let bag = [begin(0), chunk("none", &messages(0..3))].concat();
        let (found, damage) = read(bag[..size.min(begin(0).len() - 1)].to_vec());
        assert_eq!((found, damage.count), (Vec::new(), 1), "{size}: {damage}");
    }
}

#[test]
fn a_bag_that_was_killed_has_what_it_had_written() {
    // The last chunk has no sizes yet, and its records follow.
    let [begin, first, _] = two_chunks("none");
    let bag = [begin, first, packed("none", 0, b""), messages(10..13)].concat();
    let (found, damage) = read(bag);
    assert_eq!(found, numbers(0..13));
    assert!(damage.is_none(), "{damage}");
    for compression in ["bz2", "lz4"] {
        let [begin, first, _] = two_chunks(compression);
        let open_chunk = pack(compression, &messages(10..13));
        let (found, damage) =
            read([begin, first, packed(compression, 0, b""), open_chunk].concat());
        assert_eq!(found, numbers(0..13), "{compression}");
        assert_eq!(damage.count, 1, "{compression}: it does not end: {damage}");
    }
}

#[test]
fn the_index_gives_connections_and_counts_and_is_not_needed() {
    let [_, first, second] = two_chunks("none");
    let at = begin(0).len() + first.len() + second.len();
    let counts = [0_u32.to_le_bytes(), 21_u32.to_le_bytes()].concat();
    let info = record(&[("op", &[6]), ("count", &1_u32.to_le_bytes())], &counts);
    let index = [connection(0, "/a", "uint32 number"), info].concat();
    let bag = [begin(at as u64), first.clone(), second.clone(), index].concat();
    let mut reader = open(bag.clone());
    assert!(reader.is_indexed() && reader.connections().contains_key(&0));
    assert_eq!(reader.indexed_messages(), Some(21));
    while reader.next_message().unwrap().is_some() {}
    assert!(reader.damage().is_none(), "{}", reader.damage());
    // An index that lies about its place, and one that is cut.
    for (index_at, size) in [(at - 3, bag.len()), (at, bag.len() - 5), (bag.len() + 9, bag.len())] {
        let mut bag = [begin(index_at as u64), bag[begin(0).len()..].to_vec()].concat();
        bag.truncate(size);
        let mut reader = open(bag);
        assert!(!reader.is_indexed());
        let mut count = 0;
        while reader.next_message().unwrap().is_some() {
            count += 1;
        }
        assert_eq!(count, 20, "{index_at}, {size}");
    }
}

#[test]
fn what_is_behind_a_broken_place_is_read() {
    for compression in COMPRESSIONS {
        let [begin, mut first, second] = two_chunks(compression);
        // The chunk claims to end behind the next one has begun.
        let size_at = first.len()
            - pack(compression, &[connection(0, "/a", "uint32 number"), messages(0..10)].concat())
                .len()
            - 4;
        let size = u32::from_le_bytes(first[size_at..size_at + 4].try_into().unwrap());
        first[size_at..size_at + 4].copy_from_slice(&(size + 30).to_le_bytes());
        let (found, damage) = read([begin.clone(), first.clone(), second.clone()].concat());
        assert_eq!(found, numbers(0..20), "{compression}: {damage}");
        assert!(!damage.is_none());
        // It claims to end too early.
        first[size_at..size_at + 4].copy_from_slice(&(size - 10).to_le_bytes());
        let (found, damage) = read([begin.clone(), first.clone(), second.clone()].concat());
        assert!(found.ends_with(&numbers(10..20)), "{compression}: {found:?}");
        assert!(!damage.is_none());
        // Its header is none.
        let garbage = vec![0xee; 300];
        let (found, damage) =
            read([begin, two_chunks(compression)[1].clone(), garbage, second].concat());
        assert_eq!(found, numbers(0..20), "{compression}: {damage}");
        assert_eq!(damage.skipped_bytes, 300);
    }
}

#[test]
fn what_claims_too_much_is_passed_over() {
    // A large message, then a small one.
    let large = [connection(0, "/a", ""), message(0, 0, &[7; 1 << 17]), messages(1..2)].concat();
    for compression in COMPRESSIONS {
        let (found, damage) = read([begin(0), chunk(compression, &large)].concat());
        assert_eq!(found, [1], "{compression}");
        let limit = 1 << 16;
        assert_eq!(damage.places[0].1, Fault::MessageSize { claimed: 1 << 17, limit });
    }
    // Chunks that unpack to far more than they are: by their word, and against it.
    let bomb = [connection(0, "/a", ""), message(0, 0, &vec![0; 8 << 20]), messages(1..2)].concat();
    for compression in ["bz2", "lz4"] {
        let second = chunk(compression, &messages(10..20));
        let (found, damage) = read(
            [
                begin(0),
                chunk(compression, &bomb),
                chunk("none", &connection(0, "/a", "")),
                second.clone(),
            ]
            .concat(),
        );
        assert_eq!(found, numbers(10..20), "{compression}: {damage}");
        assert!(matches!(damage.places[0].1, Fault::ChunkSize { .. }), "{damage}");
        let lying = packed(compression, 1000, &pack(compression, &bomb));
        let (found, damage) = read([begin(0), lying, second].concat());
        assert!(found.ends_with(&numbers(10..20)), "{compression}: {damage}");
        assert!(!damage.is_none());
        let records = [connection(0, "/a", ""), messages(0..3)].concat();
        let longer = [records.clone(), messages(3..4)].concat();
        let lying = packed(compression, records.len(), &pack(compression, &longer));
        let (found, damage) = read([begin(0), lying].concat());
        assert_eq!(found, [0, 1, 2], "{compression}");
        assert!(matches!(damage.places[0].1, Fault::ChunkGoesOn { .. }), "{damage}");
    }
    // Records of claimed sizes that the file has not: no memory is taken for them.
    let lying = [&begin(0)[..], &u32::MAX.to_le_bytes(), b"op"].concat();
    let (found, damage) = read(lying);
    assert!(found.is_empty() && !damage.is_none());
    let (_, damage) = read([begin(0), chunk("zip", b"abc")].concat());
    assert_eq!(damage.places[0].1, Fault::Compression("zip".to_owned()));
    let (_, damage) = read([begin(0), chunk("none", &messages(0..2))].concat());
    assert_eq!((damage.count, &damage.places[0].1), (2, &Fault::NoConnection(0)));
}

/// Chunks behind the first one packed by bz2 are unpacked ahead, by other threads.
#[test]
fn chunks_that_lie_among_others_cost_no_message_of_these() {
    let good = |numbers| chunk("bz2", &messages(numbers));
    let first = chunk("bz2", &[connection(0, "/a", "uint32 number"), messages(0..10)].concat());
    let records = messages(100..200);
    let bytes = pack("bz2", &records);
    let mut broken = bytes.clone();
    let middle = broken.len() / 2;
    broken[middle] ^= 0x55;
    let bomb = pack("bz2", &message(0, 0, &vec![0; 8 << 20]));
    let index = record(&[("op", &[4]), ("count", &0_u32.to_le_bytes())], b"");
    for (lie, lying, whole) in [
        ("nothing", packed("bz2", records.len(), &bytes), 100),
        ("it goes on", packed("bz2", records.len() / 2, &bytes), 50),
        ("it ends early", packed("bz2", records.len() + 9, &bytes), 100),
        ("it is a bomb", packed("bz2", 1000, &bomb), 0),
        ("it claims a bomb", packed("bz2", 64 << 20, &bytes), 0),
        ("it is broken", packed("bz2", records.len(), &broken), 0),
        ("it is of lz4", packed("bz2", records.len(), &pack("lz4", &records)), 0),
        ("it is empty", packed("bz2", records.len(), b""), 0),
        ("it is not packed", chunk("none", &records), 100),
        ("it is packed by lz4", chunk("lz4", &records), 100),
    ] {
        let behind = (2..40).map(|ten| [good(ten * 10..ten * 10 + 10), index.clone()].concat());
        let behind = behind.collect::<Vec<_>>().concat();
        let bag = [&begin(0)[..], &first, &index, &good(10..20), &lying, &behind].concat();
        let (found, damage) = read(bag);
        assert!(found.starts_with(&numbers(0..20)), "{lie}: {found:?}");
        assert!(found.ends_with(&numbers(20..400)), "{lie}: {found:?}");
        assert_eq!(found.len(), 400 + whole, "{lie}: {damage}");
        let is_true = ["nothing", "it is not packed", "it is packed by lz4"].contains(&lie);
        assert_eq!(damage.is_none(), is_true, "{lie}: {damage}");
    }
}

#[test]
fn what_is_no_bag_is_told() {
    let error = |bytes: &[u8]| {
        let opened = BagReader::open(Cursor::new(bytes.to_vec()), Limits::default());
        opened.unwrap_err().to_string()
    };
    assert!(error(b"").contains("it is empty"));
    assert!(error(b"\x89MCAP0\r\n1234567").contains("an MCAP file already"));
    assert!(error(b"SQLite format 3\0").contains("a database"));
    assert!(error(b"#ROSBAG V1.2\n\n").contains("format 1.2"));
    let encrypted = record(&[("op", &[3]), ("encryptor", b"rosbag/AesCbcEncryptor")], b"");
    assert!(error(&[b"#ROSBAG V2.0\n", &encrypted[..]].concat()).contains("encrypted"));
}

proptest! {
    /// All that was whole before a cut is read, and the cut is told.
    #[test]
    fn a_cut_bag_gives_what_is_whole(compression in 0..3_usize, cut in 0..1200_usize) {
        let [begin, first, second] = two_chunks(COMPRESSIONS[compression]);
        let ends = [begin.len(), begin.len() + first.len()];
        let mut bag = [begin, first, second].concat();
        let cut = cut.clamp(13, bag.len());
        bag.truncate(cut);
        let (found, damage) = read(bag);
        let whole = if cut >= ends[1] { 10 } else { 0 };
        prop_assert!(found.len() >= whole);
        prop_assert_eq!(&found, &numbers(0..found.len() as u32));
        let is_between = [13, ends[0], ends[1]].contains(&cut);
        prop_assert!(!damage.is_none() || found.len() == 20 || is_between, "{cut}: {found:?}");
    }

    /// Bytes that are changed anywhere break no more than their chunk, and nothing panics.
    #[test]
    fn changed_bytes_break_one_chunk(
        compression in 0..3_usize,
        at in 0.0..1.0_f64,
        bytes in proptest::collection::vec(any::<u8>(), 1..9),
    ) {
        let [begin, first, second] = two_chunks(COMPRESSIONS[compression]);
        let middle = [first.clone(), second].concat();
        let place = (at * middle.len() as f64) as usize;
        let mut bag = [&begin[..], &first, &middle, &chunk(COMPRESSIONS[compression], &messages(20..30))].concat();
        for (offset, byte) in bytes.iter().enumerate() {
            if let Some(old) = bag.get_mut(begin.len() + first.len() + place + offset) {
                *old = *byte;
            }
        }
        let (found, _) = read(bag);
        prop_assert!(found.starts_with(&numbers(0..10)), "{found:?}");
    }

    /// Any bytes end, without a panic.
    #[test]
    fn any_bytes_end(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let (_, _) = read([&begin(7)[..], &bytes].concat());
    }
}
