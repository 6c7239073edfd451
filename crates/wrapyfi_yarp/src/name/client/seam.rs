//! A client of a name server, as ports need it.

use super::{NameClient, NameError};
use crate::port::names::{Later, NameRequest, Names, NamesError, Registration};
use crate::{Bottle, Value};

/// Ports ask their name server through this.
impl Names for NameClient {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        Box::pin(async { Ok(Self::register(self, request).await?) })
    }

    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>> {
        Box::pin(async { Ok(Self::query(self, name).await?) })
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        Box::pin(async { Ok(Self::unregister(self, name).await?) })
    }

    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()> {
        Box::pin(async move { Ok(Self::announce(self, name, alive).await?) })
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        Box::pin(async move {
            let values: Vec<_> = values.iter().map(|value| Value::from(value.as_str())).collect();
            Self::set(self, name, key, &values).await?;
            Ok(())
        })
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        Box::pin(async move {
            let values = Self::get(self, name, key).await?;
            let text = |value: Value| match value {
                Value::String(text) => text.to_string_lossy().into_owned(),
                other => Bottle::from(vec![other]).to_text(),
            };
            Ok(values.into_iter().map(text).collect())
        })
    }

    fn list<'a>(&'a self, prefix: &'a str) -> Later<'a, Vec<Registration>> {
        Box::pin(async { Ok(Self::list(self, prefix).await?) })
    }
}

impl From<NameError> for NamesError {
    fn from(error: NameError) -> Self {
        match error {
            NameError::BadName { .. } | NameError::Refused { .. } => {
                Self::Refused(error.to_string())
            }
            NameError::Nonsense { answer, .. } => Self::Nonsense(answer),
            NameError::Exchange { .. } => Self::Unreachable(error.to_string()),
        }
    }
}
