//! The thread's work on a graph that is made up.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Mutex;

use wrapyfi_interfaces::type_description_interfaces::srv::GetTypeDescription_Request;

use super::*;
use crate::graph::{
    CdrClient, CdrReader, CdrRequest, CdrSample, CdrServer, CdrWriter, DiscoveredEndpoint,
    NodeWatch, PeerWatch, Peers, RequestId, ServiceMapping, WriterTraits,
};
use wrapyfi_endpoint::BridgeMark;
use wrapyfi_node::NodeName;

/// Errors that the graph's servers return in turn; after them nothing waits.
type Script = Arc<Mutex<VecDeque<GraphError>>>;

struct MadeUp {
    node: NodeName,
    script: Script,
}

/// Every endpoint of the graph.
struct ScriptedEndpoint(Script);

fn nothing<T>() -> Result<T, GraphError> {
    Err(stack("not made up"))
}

fn stack(reason: &str) -> GraphError {
    GraphError::Stack { operation: "taking", topic: "/t".into(), reason: reason.into() }
}

impl Graph for MadeUp {
    fn node(&self) -> &NodeName {
        &self.node
    }

    fn for_other(&self, _: &NodeName) -> Result<Arc<dyn Graph>, GraphError> {
        nothing()
    }

    fn advertise_with(
        &self,
        _: &TopicDescription,
        _: WriterTraits<'_>,
        _: Notify,
    ) -> Result<Box<dyn CdrWriter>, GraphError> {
        Ok(Box::new(ScriptedEndpoint(Script::default())))
    }

    fn subscribe(&self, _: &TopicDescription, _: Notify) -> Result<Box<dyn CdrReader>, GraphError> {
        Ok(Box::new(ScriptedEndpoint(Script::default())))
    }

    fn service_mapping(&self) -> Option<ServiceMapping> {
        Some(ServiceMapping::Cyclone)
    }

    fn client(&self, _: &ServiceDescription, _: Notify) -> Result<Box<dyn CdrClient>, GraphError> {
        nothing()
    }

    fn server_marked(
        &self,
        _: &ServiceDescription,
        _: Option<&BridgeMark>,
        _: Notify,
    ) -> Result<Box<dyn CdrServer>, GraphError> {
        Ok(Box::new(ScriptedEndpoint(Arc::clone(&self.script))))
    }

    fn endpoints(&self) -> Result<Vec<DiscoveredEndpoint>, GraphError> {
        nothing()
    }

    fn watch(&self, _: &str, _: bool, _: Notify) -> Result<Box<dyn PeerWatch>, GraphError> {
        nothing()
    }

    fn nodes(&self) -> Result<Box<dyn NodeWatch>, GraphError> {
        nothing()
    }
}

impl CdrWriter for ScriptedEndpoint {
    fn write(&mut self, _: &[&[u8]]) -> Result<(), GraphError> {
        Ok(())
    }

    fn matched(&self) -> usize {
        0
    }

    fn incompatible(&self) -> Option<&'static str> {
        None
    }
}

impl CdrReader for ScriptedEndpoint {
    fn take(&mut self) -> Result<Option<CdrSample>, GraphError> {
        Ok(None)
    }

    fn matched(&self) -> usize {
        0
    }

    fn lost(&mut self) -> u64 {
        0
    }

    fn incompatible(&self) -> Option<&'static str> {
        None
    }
}

impl CdrServer for ScriptedEndpoint {
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        self.0.lock().unwrap().pop_front().map_or(Ok(None), Err)
    }

    fn hears(&self, _: &RequestId) -> bool {
        false
    }

    fn reply(&mut self, _: &RequestId, _: &[&[u8]]) -> Result<(), GraphError> {
        nothing()
    }

    fn clients(&self) -> Peers {
        Peers::None
    }

    fn lost(&mut self) -> u64 {
        0
    }
}

/// The work of a node with one service, and its handle.
fn work(script: &Script) -> (Work, NodeHandle) {
    let node = NodeName::new("camera", "/robot").unwrap();
    let mut store = ParameterStore::new(&node, BTreeMap::new()).unwrap();
    let wake = wrapyfi_endpoint::Wake::new();
    let watch = store.watch(&["use_sim_time"], &wake);
    let shared = Arc::new(NodeState::new(store, RosTime::new(false), wake));
    let graph: Arc<dyn Graph> = Arc::new(MadeUp { node, script: Arc::clone(script) });
    let end = || Box::new(ScriptedEndpoint(Script::default()));
    let server =
        Served::new(Answers::Types, Box::new(ScriptedEndpoint(Arc::clone(script))), "/service");
    let topics = Topics { rosout: end(), events: end() };
    let work = Work::new(&shared, &graph, Some(topics), vec![server], watch);
    (work, NodeHandle(shared))
}

#[test]
fn what_lasts_is_counted_once_per_change() {
    let script = Script::default();
    let (mut work, handle) = work(&script);
    let mut say = |errors: &[GraphError]| {
        script.lock().unwrap().extend(errors.iter().cloned());
        // One look for each, and one that finds nothing.
        for _ in 0..=errors.len() {
            work.answer();
        }
        handle.refused_requests()
    };
    let (one, other) = (stack("no memory"), stack("no room"));
    assert_eq!(say(&vec![one.clone(); 50]), 1);
    // Nothing was said in between.
    assert_eq!(say(&[one.clone(), one.clone(), other.clone(), other, one]), 4);
    // A message that arrives and is refused counts each time.
    let too_large = GraphError::TooLarge { topic: "/t".into(), actual: 2, limit: 1 };
    assert_eq!(say(&vec![too_large; 5]), 9);
}

#[test]
fn the_clock_is_described_while_it_is_listened_to() {
    let (mut work, handle) = work(&Script::default());
    work.describe_own_types(false);
    let request = GetTypeDescription_Request {
        type_name: Clock::ROS_TYPE.into(),
        type_hash: Clock::TYPE_HASH.into(),
        include_type_sources: true,
    };
    let described = || handle.types(|types| types.answer(&request));
    for _ in 0..2 {
        assert!(!described().successful);
        handle.parameters(|store| store.set("use_sim_time", true)).unwrap();
        work.follow_clock();
        work.follow_clock();
        assert!(described().successful);
        assert!(described().type_sources[0].raw_file_contents.contains("clock"));
        handle.parameters(|store| store.set("use_sim_time", false)).unwrap();
        work.follow_clock();
    }
    assert!(!described().successful);
}
