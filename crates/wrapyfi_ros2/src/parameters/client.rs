//! Reads and sets the parameters of another node.

use std::collections::HashSet;

use wrapyfi_interfaces::rcl_interfaces::msg;
use wrapyfi_interfaces::rcl_interfaces::srv::{
    GetParameterTypes, GetParameterTypes_Request, GetParameters, GetParameters_Request,
    ListParameters, ListParameters_Request, SetParameters, SetParameters_Request,
};

use super::asker::Asker;
use super::options::{CHUNK, MAX_NAMES, ServiceOptions, node_name};
use super::{ParameterClientError, ParameterResult};
use crate::graph::Peers;
use crate::ros2::Ros2;
use wrapyfi_data::types::{ParameterType, ParameterValue, Properties};
use wrapyfi_endpoint::Wake;
use wrapyfi_node::parameters::{Parameter, ParameterService};

/// Reads and sets the parameters of another node. Every method waits for the node: as long as the
/// time-out of the options, for each request that it takes. Clients of services are opened when they
/// are wanted.
///
/// ```no_run
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_ros2 as ros2; }
/// # }
/// use wrapyfi_core::endpoint::Wake;
/// use wrapyfi_core::middleware::ros2::{ParameterClient, Ros2, ServiceOptions};
/// use wrapyfi_core::types::Properties;
/// # fn example(ros2: &Ros2) -> Result<(), Box<dyn std::error::Error>> {
/// let options = ServiceOptions::default();
/// let mut talker = ParameterClient::open(ros2, "/talker", &options, &Wake::new())?;
/// println!("{:?}", talker.list()?);
/// let gain = talker.get(&["gain"])?;
/// talker.set(&Properties::from([("gain", 2.5)]))?;
/// # Ok(())
/// # }
/// ```
pub struct ParameterClient {
    ros2: Ros2,
    node: String,
    options: ServiceOptions,
    wake: Wake,
    list: Option<Asker<ListParameters>>,
    get: Option<Asker<GetParameters>>,
    types: Option<Asker<GetParameterTypes>>,
    set: Option<Asker<SetParameters>>,
}

/// The client of a service, opened at its first use.
macro_rules! asker {
    ($self:ident, $slot:ident, $which:ident) => {{
        let Self { ros2, node, options, wake, $slot, .. } = $self;
        match $slot {
            Some(asker) => asker,
            None => {
                let asker = Asker::open(ros2, node, ParameterService::$which, options, wake)?;
                $slot.insert(asker)
            }
        }
    }};
}

impl ParameterClient {
    /// A client of `node`, a name in our namespace unless it is absolute. The node need not be there.
    /// `wake` is rung when it comes or goes; it is waited on by every method.
    ///
    /// # Errors
    /// When no node can be called so, or DDS refuses.
    pub fn open(
        ros2: &Ros2,
        node: &str,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> ParameterResult<Self> {
        let node = node_name(ros2, node)?;
        // One at once, which knows whether the node is there.
        let set = Asker::open(ros2, &node, ParameterService::Set, options, wake)?;
        Ok(Self {
            ros2: ros2.clone(),
            node,
            options: options.clone(),
            wake: wake.clone(),
            list: None,
            get: None,
            types: None,
            set: Some(set),
        })
    }

    /// Full name of the node.
    pub fn node(&self) -> &str {
        &self.node
    }

    /// Readiness of the node's parameter services.
    #[doc(hidden)]
    pub fn servers(&self) -> Peers {
        self.set.as_ref().map_or(Peers::None, Asker::servers)
    }

    /// Names of all parameters, in the order in which the node tells them.
    ///
    /// # Errors
    /// When the node is absent, does not answer, or has more than 65536.
    pub fn list(&mut self) -> ParameterResult<Vec<String>> {
        let asker = asker!(self, list, List);
        let names = asker.ask(&ListParameters_Request::default())?.result.names;
        if names.len() > MAX_NAMES {
            return Err(too_many(&self.node, names.len()));
        }
        Ok(names)
    }

    /// Values of the parameters of these names. One that is declared and has no value is
    /// [`ParameterValue::NotSet`].
    ///
    /// # Errors
    /// When the node is absent or does not answer, or has not declared one of them.
    pub fn get<N: AsRef<str>>(&mut self, names: &[N]) -> ParameterResult<Properties> {
        let mut found = Properties::new();
        for names in names.chunks(CHUNK) {
            let names: Vec<String> = names.iter().map(|name| name.as_ref().to_owned()).collect();
            match self.get_all_or_none(&names)? {
                Some(values) => found.extend(values),
                None => {
                    self.check_declared(&names)?;
                    for name in names {
                        let one = self.get_all_or_none(std::slice::from_ref(&name))?;
                        match one {
                            Some(value) => found.extend(value),
                            None => _ = found.insert(name, ParameterValue::NotSet),
                        }
                    }
                }
            }
        }
        Ok(found)
    }

    /// Sets parameters, each for itself; one without a value is deleted, where the node allows it. An
    /// empty list takes the type that the node has declared.
    ///
    /// # Errors
    /// When the node is absent or does not answer, or refused some of them: which, and why.
    pub fn set(&mut self, properties: &Properties) -> ParameterResult<()> {
        if properties.is_empty() {
            return Ok(());
        }
        let parameters = self.typed(properties)?;
        let asker = asker!(self, set, Set);
        let results = asker.ask(&SetParameters_Request { parameters })?.results;
        let of = properties.len();
        if results.len() != of {
            return Err(asker.fault(counts(results.len(), of)));
        }
        let refused: Vec<(String, String)> = properties
            .names()
            .zip(results)
            .filter(|(_, result)| !result.successful)
            .map(|(name, result)| match result.reason {
                none if none.is_empty() => (name.to_owned(), "no reason given".to_owned()),
                reason => (name.to_owned(), reason),
            })
            .collect();
        if refused.is_empty() {
            return Ok(());
        }
        Err(ParameterClientError::Refused { node: self.node.clone(), refused, of })
    }

    /// Values in the order of `names`, or none where the node lacks one of them.
    fn get_all_or_none(
        &mut self,
        names: &[String],
    ) -> ParameterResult<Option<Vec<(String, ParameterValue)>>> {
        let asker = asker!(self, get, Get);
        let values = asker.ask(&GetParameters_Request { names: names.to_vec() })?.values;
        if values.len() != names.len() {
            return Ok(None);
        }
        let mut found = Vec::with_capacity(values.len());
        for (name, value) in names.iter().zip(values) {
            let value = ParameterValue::try_from(value);
            let value = value.map_err(|error| asker.fault(format!("{name}: {error}")))?;
            found.push((name.clone(), value));
        }
        Ok(Some(found))
    }

    fn check_declared(&mut self, names: &[String]) -> ParameterResult<()> {
        let declared: HashSet<String> = self.list()?.into_iter().collect();
        let names: Vec<String> =
            names.iter().filter(|name| !declared.contains(*name)).cloned().collect();
        if names.is_empty() {
            return Ok(());
        }
        Err(ParameterClientError::NotDeclared { node: self.node.clone(), names })
    }

    /// The parameters as messages, where empty lists have the type that the node has declared.
    fn typed(&mut self, properties: &Properties) -> ParameterResult<Vec<msg::Parameter>> {
        let mut types = Vec::new();
        let names: Vec<String> = properties
            .iter()
            .filter(|(_, value)| is_empty_list(value))
            .map(|(name, _)| name.to_owned())
            .collect();
        for name in names {
            let asker = asker!(self, types, GetTypes);
            let request = GetParameterTypes_Request { names: vec![name.clone()] };
            let kind = asker.ask(&request)?.types.first().copied();
            types.push((name, kind.and_then(ParameterType::from_number)));
        }
        let mut types = types.into_iter().peekable();
        let parameters = properties.iter().map(|(name, value)| {
            let kind = types.next_if(|(empty, _)| empty == name).and_then(|(_, kind)| kind);
            let value = kind.and_then(ParameterType::empty_list).unwrap_or_else(|| value.clone());
            msg::Parameter::from(Parameter::new(name, value))
        });
        Ok(parameters.collect())
    }
}

/// True of a list that says nothing of its type.
fn is_empty_list(value: &ParameterValue) -> bool {
    value.parameter_type().empty_list().as_ref() == Some(value)
}

pub(super) fn counts(answers: usize, questions: usize) -> String {
    format!("{answers} answers to {questions} names")
}

pub(super) fn too_many(node: &str, actual: usize) -> ParameterClientError {
    let (node, what) = (node.to_owned(), "names of parameters:");
    ParameterClientError::TooMuch { node, what, actual, limit: MAX_NAMES }
}
