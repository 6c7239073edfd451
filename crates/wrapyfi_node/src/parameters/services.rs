//! The six services that every node offers for its parameters.

use bytes::Bytes;
use wrapyfi_interfaces::cdr::{CdrError, CdrParts};
use wrapyfi_interfaces::rcl_interfaces::msg::{self, SetParametersResult};
use wrapyfi_interfaces::rcl_interfaces::srv::{
    DescribeParameters, DescribeParameters_Request, DescribeParameters_Response, GetParameterTypes,
    GetParameterTypes_Request, GetParameterTypes_Response, GetParameters, GetParameters_Request,
    GetParameters_Response, ListParameters, ListParameters_Request, ListParameters_Response,
    SetParameters, SetParameters_Request, SetParameters_Response, SetParametersAtomically,
    SetParametersAtomically_Request, SetParametersAtomically_Response,
};
use wrapyfi_interfaces::{Message, Service, ServiceHashes};

use super::{MAX_PARAMETERS, MAX_REPLY_BYTES, Parameter, ParameterStore, SetError};

/// Bytes that a value or a descriptor takes in a reply beside its texts and numbers.
const FIXED_BYTES: usize = 64;

node_services! {
    /// One of the services.
    ParameterService {
        Describe: DescribeParameters = "describe_parameters",
        Get: GetParameters = "get_parameters",
        GetTypes: GetParameterTypes = "get_parameter_types",
        List: ListParameters = "list_parameters",
        Set: SetParameters = "set_parameters",
        SetAtomically: SetParametersAtomically = "set_parameters_atomically",
    }
}

impl ParameterService {
    /// Number of requests and replies that nodes keep of each service.
    pub const DEPTH: u32 = 1000;
}

impl ParameterStore {
    /// Answers a request to one of the services. Its changes wait in
    /// [`take_events`](Self::take_events).
    ///
    /// # Errors
    /// When `request` has more than `max_bytes` bytes or is no request of this service; there is
    /// nothing to answer then.
    pub fn answer(
        &mut self,
        service: ParameterService,
        request: &Bytes,
        max_bytes: usize,
    ) -> Result<CdrParts, CdrError> {
        fn read<M: Message>(request: &Bytes, max_bytes: usize) -> Result<M, CdrError> {
            M::decode(request, max_bytes)
        }
        Ok(match service {
            ParameterService::Describe => {
                self.describe_parameters(&read(request, max_bytes)?).encode()
            }
            ParameterService::Get => self.get_parameters(&read(request, max_bytes)?).encode(),
            ParameterService::GetTypes => {
                self.get_parameter_types(&read(request, max_bytes)?).encode()
            }
            ParameterService::List => self.list_parameters(&read(request, max_bytes)?).encode(),
            ParameterService::Set => self.set_parameters(read(request, max_bytes)?).encode(),
            ParameterService::SetAtomically => {
                self.set_parameters_atomically(read(request, max_bytes)?).encode()
            }
        })
    }

    /// Answers `~/describe_parameters`: nothing at all where one of the names is not declared.
    pub fn describe_parameters(
        &self,
        request: &DescribeParameters_Request,
    ) -> DescribeParameters_Response {
        let descriptors = self.each(&request.names, |store, name| {
            let descriptor = store.describe(name)?;
            let texts =
                [&descriptor.name, &descriptor.description, &descriptor.additional_constraints];
            let size = texts.iter().fold(0, |sum: usize, text| sum.saturating_add(text.len()));
            Some((msg::ParameterDescriptor::from(descriptor), size))
        });
        DescribeParameters_Response { descriptors }
    }

    /// Answers `~/get_parameters`: nothing at all where one of the names is not declared or has no
    /// value.
    pub fn get_parameters(&self, request: &GetParameters_Request) -> GetParameters_Response {
        let values = self.each(&request.names, |store, name| {
            let value = store.get(name).ok()?;
            Some((value.clone(), value.size()))
        });
        GetParameters_Response {
            values: values.into_iter().map(msg::ParameterValue::from).collect(),
        }
    }

    /// Answers `~/get_parameter_types`: nothing at all where one of the names is not declared.
    pub fn get_parameter_types(
        &self,
        request: &GetParameterTypes_Request,
    ) -> GetParameterTypes_Response {
        let types =
            self.each(&request.names, |store, name| Some((store.type_of(name)?.number(), 0)));
        GetParameterTypes_Response { types: types.into() }
    }

    /// Answers `~/list_parameters`.
    pub fn list_parameters(&self, request: &ListParameters_Request) -> ListParameters_Response {
        if request.prefixes.len() > MAX_PARAMETERS {
            return ListParameters_Response::default();
        }
        ListParameters_Response { result: self.list(&request.prefixes, request.depth) }
    }

    /// Answers `~/set_parameters`: each parameter for itself, in order.
    pub fn set_parameters(&mut self, request: SetParameters_Request) -> SetParameters_Response {
        let (count, limit) = (request.parameters.len(), MAX_PARAMETERS);
        if count > limit {
            let refused = result(Err(SetError::TooMany { count, limit }));
            return SetParameters_Response { results: vec![refused; count] };
        }
        let set =
            |one| result(Parameter::try_from(one).and_then(|one| self.set_atomically(vec![one])));
        SetParameters_Response { results: request.parameters.into_iter().map(set).collect() }
    }

    /// Answers `~/set_parameters_atomically`: all parameters or none.
    pub fn set_parameters_atomically(
        &mut self,
        request: SetParametersAtomically_Request,
    ) -> SetParametersAtomically_Response {
        let parameters: Result<Vec<_>, _> =
            request.parameters.into_iter().map(Parameter::try_from).collect();
        let result = result(parameters.and_then(|parameters| self.set_atomically(parameters)));
        SetParametersAtomically_Response { result }
    }

    /// Collects the result of `find` for each name. Empty where a name has no result, or where all
    /// together exceed the size of a reply.
    fn each<T>(
        &self,
        names: &[String],
        find: impl Fn(&Self, &str) -> Option<(T, usize)>,
    ) -> Vec<T> {
        let mut found = Vec::new();
        let mut total: usize = 0;
        for name in names {
            let Some((one, size)) = find(self, name) else { return Vec::new() };
            total = total.saturating_add(size).saturating_add(FIXED_BYTES);
            if total > MAX_REPLY_BYTES || names.len() > MAX_PARAMETERS {
                return Vec::new();
            }
            found.push(one);
        }
        found
    }
}

fn result(set: Result<(), SetError>) -> SetParametersResult {
    match set {
        Ok(()) => SetParametersResult { successful: true, reason: String::new() },
        Err(error) => SetParametersResult { successful: false, reason: error.reason() },
    }
}
