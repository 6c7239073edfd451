//! Changes of one node's parameters, read from `/parameter_events`.

use wrapyfi_interfaces::rcl_interfaces::msg::{self, ParameterEvent};

use wrapyfi_data::types::{ParameterValue, Properties};

/// Changes that an event makes to `known`; a parameter that it deletes is without a value.
///
/// # Errors
/// Names the parameter whose value has no type that ROS 2 knows.
pub(super) fn changes_by(known: &Properties, event: ParameterEvent) -> Result<Properties, String> {
    let mut changes = Properties::new();
    for msg::Parameter { name, value } in
        event.new_parameters.into_iter().chain(event.changed_parameters)
    {
        let value = ParameterValue::try_from(value);
        let value = value.map_err(|error| format!("{name}: {error}"))?;
        if known.get(&name) != Some(&value) {
            changes.insert(name, value);
        }
    }
    for msg::Parameter { name, .. } in event.deleted_parameters {
        if known.get(&name).is_some() {
            changes.insert(name, ParameterValue::NotSet);
        }
    }
    Ok(changes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_node::parameters::Parameter;

    #[test]
    fn an_event_says_what_is_new_changed_and_gone() {
        let known = Properties::from([("same", 1_i64), ("changed", 2), ("gone", 3)]);
        let messages = |pairs: &[(&str, i64)]| -> Vec<msg::Parameter> {
            pairs.iter().map(|&(name, value)| Parameter::new(name, value).into()).collect()
        };
        let event = ParameterEvent {
            new_parameters: messages(&[("new", 4)]),
            changed_parameters: messages(&[("same", 1), ("changed", 5)]),
            deleted_parameters: messages(&[("gone", 0), ("unheard_of", 0)]),
            ..ParameterEvent::default()
        };
        let changes = changes_by(&known, event).unwrap();
        let told: Vec<_> = changes.iter().map(|(name, value)| format!("{name}={value}")).collect();
        assert_eq!(told, ["new=4", "changed=5", "gone=not set"]);
        let mut odd =
            ParameterEvent { new_parameters: messages(&[("a", 1)]), ..Default::default() };
        odd.new_parameters[0].value.r#type = 99;
        assert!(changes_by(&known, odd).unwrap_err().contains("99"));
    }
}
