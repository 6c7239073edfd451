//! Ports that stay registered, without doing anything for it.

use super::{Registrar, release};
use crate::port::names::{Later, NameRequest, Names, Registration};

/// For ports: whatever registers through this stays registered until it unregisters.
impl Names for Registrar {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        Box::pin(async {
            let at = self.client().register(request).await?;
            // Groups belong to a port that opens them again; their numbers mean nothing later.
            if at.carrier != "mcast" {
                self.0.shared.insert(at.clone(), request.type_name.clone());
            }
            Ok(at)
        })
    }

    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>> {
        Names::query(self.client(), name)
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        Box::pin(async move {
            match self.0.shared.forget(name) {
                Some(wanted) => Ok(release(self.client(), &wanted).await?),
                None => Ok(self.client().unregister(name).await?),
            }
        })
    }

    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()> {
        if alive {
            self.0.shared.change(name, |wanted| wanted.announced = true);
        }
        Names::announce(self.client(), name, alive)
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        self.0.shared.change(name, |wanted| {
            let values = values.iter().map(|value| value.as_str().into()).collect();
            wanted.properties.insert(key.to_owned(), values);
        });
        Names::set(self.client(), name, key, values)
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        Names::get(self.client(), name, key)
    }

    fn list<'a>(&'a self, prefix: &'a str) -> Later<'a, Vec<Registration>> {
        Names::list(self.client(), prefix)
    }
}
