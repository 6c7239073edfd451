//! Targets of what nodes announce of themselves and of their endpoints.

use bytes::Bytes;
use wrapyfi_endpoint::BridgeMark;
use {wrapyfi_ros1 as ros1, wrapyfi_ros2 as ros2};

use crate::{LIMITS, bounded};

/// Memory for each byte of an announcement: a node without a name is four texts and lists.
const NODES: usize = 64;

/// Announcement of a node of ROS 2. The first byte chooses: USER_DATA of an endpoint, or its nodes as
/// `ros_discovery_info`.
pub fn ros2_discovery(data: &[u8]) {
    let [choice, bytes @ ..] = data else { return };
    if choice % 2 == 0 {
        let found = bounded(bytes.len(), 16, || ros2::offline::user_data(bytes));
        if let Some(id) = &found.id {
            assert!(id.len() <= 64);
        }
        let written =
            ros2::offline::write_user_data(found.type_hash.as_deref(), found.mark.as_ref());
        let again = ros2::offline::user_data(written.as_bytes());
        assert_eq!((again.type_hash, again.mark), (found.type_hash, found.mark), "{written:?}");
        return;
    }
    let cdr = Bytes::copy_from_slice(bytes);
    let read = |cdr| ros2::offline::announcement(cdr, LIMITS.message_bytes);
    let Some((names, written)) = bounded(bytes.len(), NODES, || read(&cdr)) else { return };
    assert!(names.len() <= bytes.len());
    // Today's form is no longer than that of before Iron, and nothing changes any more.
    let (again, rewritten) = read(&written).expect("its own announcement");
    assert_eq!((again, rewritten), (names, written));
}

/// Marks of bridges, a line each: as they stand in USER_DATA and connection headers, or among the parameters of a
/// ROS 1 master.
pub fn bridge_marks(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    for line in text.lines() {
        if let Ok(mark) = bounded(line.len(), 64, || line.parse::<BridgeMark>()) {
            assert!(mark.to_string().eq_ignore_ascii_case(line), "{line:?}");
            assert!(mark.path.iter().all(|hop| mark.came_through(hop)));
            assert_eq!(mark.to_string().parse(), Ok(mark));
        }
        if let Some(written) = bounded(line.len(), 64, || ros1::offline::marked(line)) {
            assert_eq!(ros1::offline::marked(&written).as_deref(), Some(&*written), "{line:?}");
        }
    }
}
