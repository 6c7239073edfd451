//! Marks of bridges on rmw, which shows no USER_DATA: each bridge tells all others which of its node's endpoints have
//! which mark.
//!
//! ```text
//!   /bridge        the marked endpoints, as any node has its own
//!   /bridge/_mark  hidden: publisher and subscription of the hidden, latched topic /_wrapyfi_marks
//!
//!   /bridge                                   one message, whole at every change
//!   P rt/chatter 0196a3b2c4d5e6f7:ros,yarp    a publisher
//!   S rq/addRequest 0196a3b2c4d5e6f7:ros      a server: its subscription, and its publisher of rr/addReply
//! ```

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::sync::{Arc, OnceLock, Weak};

use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::std_msgs::msg::String as Text;
use wrapyfi_rmw::{Fault, Node, Notify, Publisher, Subscription, Taken};

use super::rmw_hashes::type_info;
use wrapyfi_endpoint::{BridgeMark, Durability, History, Mutex, Qos};
use wrapyfi_node::NodeName;

/// Topic of the bridges' messages.
pub(super) const TOPIC: &str = "/_wrapyfi_marks";
/// Name of the node that has it, in the namespace of the bridge's node.
const NODE: &str = "_mark";
/// Largest message that is read: some forty thousand endpoints.
const MAX_BYTES: usize = 4 << 20;
/// Bridges whose marks are kept.
const MAX_BRIDGES: usize = 256;

/// An endpoint of a node: true for a publisher, and its topic as the middleware spells it.
pub(super) type EndpointKey = (bool, String);

/// Marks of the own endpoints, and those that others have told.
#[derive(Default)]
pub(super) struct Marks {
    told: OnceLock<Option<Told>>,
    /// Own endpoints, each with the number of those that have the mark.
    own: Mutex<BTreeMap<EndpointKey, (BridgeMark, usize)>>,
    /// Endpoints of other bridges, by node.
    heard: Mutex<HashMap<String, HashMap<EndpointKey, BridgeMark>>>,
    looks: Mutex<Vec<Weak<Notify>>>,
}

/// The topic on which bridges tell their marks.
struct Told {
    node: String,
    publisher: Mutex<Publisher>,
    subscription: Mutex<Subscription>,
}

impl Marks {
    /// Joins the topic, the first time. `on_news` is called when others tell something; without the topic other bridges
    /// do not know what this one makes.
    pub(super) fn join(&self, name: &NodeName, node: &Node, on_news: &Notify) {
        self.told.get_or_init(|| {
            let told = Told::new(name, node, on_news);
            let warn = |fault: &Fault| {
                tracing::warn!(%fault, "this bridge and others do not know what the other makes");
            };
            told.inspect_err(warn).ok()
        });
    }

    /// Has `look` called when others have told something new, as long as it lives.
    pub(super) fn watch(&self, look: &Arc<Notify>) {
        let mut looks = self.looks.lock();
        looks.retain(|one| one.strong_count() > 0);
        looks.push(Arc::downgrade(look));
    }

    /// Reads what has come, and calls those that watch.
    pub(super) fn hear(&self) {
        if self.read() {
            let looks: Vec<_> = self.looks.lock().iter().filter_map(Weak::upgrade).collect();
            looks.iter().for_each(|look| look());
        }
    }

    /// True when something new has come.
    fn read(&self) -> bool {
        let Some(Some(told)) = self.told.get() else { return false };
        let mut is_new = false;
        loop {
            let message = match told.subscription.lock().take(MAX_BYTES) {
                Ok(Taken::Message(message)) => message,
                Ok(Taken::Nothing) => return is_new,
                Ok(Taken::TooLarge(bytes)) => {
                    tracing::warn!(bytes, limit = MAX_BYTES, "{TOPIC}: a message is too large");
                    continue;
                }
                Err(fault) => {
                    tracing::warn!(%fault, "{TOPIC}");
                    return is_new;
                }
            };
            let Ok(text) = Text::decode(&message.bytes, MAX_BYTES) else { continue };
            let Some((node, ends)) = read(&text.data) else { continue };
            let mut heard = self.heard.lock();
            if heard.len() < MAX_BRIDGES || heard.contains_key(node) {
                heard.insert(node.to_owned(), ends);
                is_new = true;
            }
        }
    }

    /// Mark of an endpoint of a node.
    pub(super) fn of(&self, node: &str, end: &EndpointKey) -> Option<BridgeMark> {
        self.heard.lock().get(node)?.get(end).cloned()
    }

    /// Tells the others of the mark of own endpoints, until the returned value is dropped.
    pub(super) fn put(self: &Arc<Self>, mark: &BridgeMark, ends: Vec<EndpointKey>) -> Marked {
        let mut own = self.own.lock();
        for end in &ends {
            let (known, count) = own.entry(end.clone()).or_insert_with(|| (mark.clone(), 0));
            known.clone_from(mark);
            *count += 1;
        }
        self.tell(&own);
        Marked { marks: Arc::clone(self), ends }
    }

    fn tell(&self, own: &BTreeMap<EndpointKey, (BridgeMark, usize)>) {
        let Some(Some(told)) = self.told.get() else { return };
        let text = Text { data: written(&told.node, own) };
        let cdr = text.encode();
        let parts: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        if let Err(fault) = told.publisher.lock().publish(&parts) {
            tracing::warn!(%fault, "{TOPIC} was not sent");
        }
    }
}

impl Told {
    fn new(name: &NodeName, node: &Node, on_news: &Notify) -> Result<Self, Fault> {
        let hidden = node.child(NODE, &name.fqn())?;
        let of = type_info(Text::ROS_TYPE, Some(Text::TYPE_HASH));
        let latched =
            |history| Qos { durability: Durability::TransientLocal, history, ..Qos::default() };
        let all = latched(History::KeepAll);
        let subscription = hidden.subscription(TOPIC, &of, &all, false, on_news)?;
        let last = latched(History::KeepLast(1));
        let publisher = hidden.publisher(TOPIC, &of, &last, Arc::new(|| {}))?;
        let (publisher, subscription) = (Mutex::new(publisher), Mutex::new(subscription));
        Ok(Self { node: name.fqn(), publisher, subscription })
    }
}

/// Own endpoints of which the others are told.
pub(super) struct Marked {
    marks: Arc<Marks>,
    ends: Vec<EndpointKey>,
}

impl Drop for Marked {
    fn drop(&mut self) {
        let mut own = self.marks.own.lock();
        for end in &self.ends {
            if let Some((_, count)) = own.get_mut(end) {
                *count -= 1;
                if *count == 0 {
                    own.remove(end);
                }
            }
        }
        self.marks.tell(&own);
    }
}

/// The bridge of which a node is the hidden one.
pub(super) fn bridge<'n>(name: &str, namespace: &'n str) -> Option<&'n str> {
    (name == NODE).then_some(namespace)
}

fn written(node: &str, own: &BTreeMap<EndpointKey, (BridgeMark, usize)>) -> String {
    let mut text = node.to_owned();
    for ((is_publisher, topic), (mark, _)) in own {
        let side = if *is_publisher { 'P' } else { 'S' };
        // Writing to a string does not fail.
        _ = write!(text, "\n{side} {topic} {mark}");
    }
    text
}

/// Node and marked endpoints of a message; lines that cannot be read are passed over.
fn read(text: &str) -> Option<(&str, HashMap<EndpointKey, BridgeMark>)> {
    let mut lines = text.lines();
    let node = lines.next().filter(|node| node.starts_with('/'))?;
    let ends = lines.filter_map(|line| {
        let mut words = line.split(' ');
        let is_publisher = match words.next()? {
            "P" => true,
            "S" => false,
            _ => return None,
        };
        Some(((is_publisher, words.next()?.to_owned()), words.next()?.parse().ok()?))
    });
    Some((node, ends.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_bridge_tells_is_read() {
        let mark = BridgeMark { bridge: 7, path: vec!["ros".into(), "yarp".into()] };
        let [chatter, add] = [(true, "rt/chatter".to_owned()), (false, "rq/addRequest".to_owned())];
        let own = BTreeMap::from([
            (chatter.clone(), (mark.clone(), 1)),
            (add.clone(), (mark.clone(), 2)),
        ]);
        let text = written("/lab/bridge", &own);
        let ends = HashMap::from([(chatter, mark.clone()), (add, mark)]);
        assert_eq!(read(&text), Some(("/lab/bridge", ends)));
        assert_eq!(read("/bridge"), Some(("/bridge", HashMap::new())));
        for wrong in
            ["/bridge\nP rt/a", "/bridge\nX rt/a 0000000000000007:ros", "/bridge\n\nP rt/a 7"]
        {
            assert_eq!(read(wrong), Some(("/bridge", HashMap::new())), "{wrong}");
        }
        for wrong in ["", "bridge\nP rt/a 0000000000000007:ros"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn the_hidden_node_names_its_bridge() {
        assert_eq!(bridge("_mark", "/lab/bridge"), Some("/lab/bridge"));
        assert_eq!(bridge("talker", "/lab"), None);
    }
}
