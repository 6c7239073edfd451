//! Requests and commands as clients of YARP write them, in YARP's text form.

use std::f64::consts::{FRAC_PI_2, PI};
use std::time::Duration;

use super::super::super::options::YarpOptions;
use super::super::axes::Joints;
use super::*;
use proptest::prelude::*;
use wrapyfi_yarp::WireLimits;

const NOW: Stamp = Stamp { count: 7, time_s: 12.5 };

/// A board with a joint that turns, between -90 and 90 degrees, and one that slides.
fn axes() -> Axes {
    let options = YarpOptions {
        joints: vec!["pan".into(), "lift".into()],
        prismatic: vec!["lift".into()],
        ranges: [("pan".to_owned(), (-90.0, 90.0))].into(),
        ..YarpOptions::default()
    };
    let state = Joints {
        names: vec!["lift", "pan"],
        position: vec![0.25, FRAC_PI_2 / 2.0],
        ..Joints::default()
    };
    let mut axes = Axes::new(&options);
    axes.take(&state, &options).unwrap();
    axes
}

fn bottle(text: &str) -> Bottle {
    Bottle::from_text(text.as_bytes(), &WireLimits::default()).unwrap()
}

fn asked(axes: &mut Axes, text: &str, carries: Carries) -> (String, Option<Movement>) {
    let (answer, movement) = answer(axes, &bottle(text), carries, NOW);
    (answer.to_text(), movement)
}

#[test]
fn what_clients_ask_is_answered_as_a_board_of_yarp_answers() {
    let mut axes = axes();
    for (request, wanted) in [
        ("[get] [prot]", "[prot] 1 9 0 [ok]"),
        ("[get] [axes]", "[is] [axes] 2 [tsta] 7 12.5 [ok]"),
        ("get axes", "[is] axes 2 [tsta] 7 12.5 [ok]"),
        ("[get] [name] 1", "[is] [name] lift [tsta] 7 12.5 [ok]"),
        ("[get] [llim] 0", "[is] [llim] -90.0 90.0 [tsta] 7 12.5 [ok]"),
        ("[get] [enc] 0", "[is] [enc] 45.0 [tsta] 7 12.5 [ok]"),
        ("[get] [encs]", "[is] [encs] (45.0 0.25) [tsta] 7 12.5 [ok]"),
        ("[get] [posg] 1 (1)", "[is] [posg] (0.25) [tsta] 7 12.5 [ok]"),
        ("[get] [velg] 1 (0)", "[is] [velg] (10.0) [tsta] 7 12.5 [ok]"),
        ("[get] [dons]", "[is] [dons] 1 [tsta] 7 12.5 [ok]"),
        ("[get] [icmd] [cmod] 1", "[is] 1 [pos] [tsta] 7 12.5 [ok]"),
        ("[get] [icmd] [cmds]", "[is] [cmds] ([pos] [pos]) [tsta] 7 12.5 [ok]"),
        ("[get] [intm] [mods]", "[is] [mods] ([stif] [stif]) [tsta] 7 12.5 [ok]"),
        ("[get] [enc] 2", "[fail]"),
        ("[get] [enc] -1", "[fail]"),
        ("[get] [posg] 2 (1)", "[fail]"),
        ("[get] [pid] 0", "[fail]"),
        ("[set] [pos]", "[fail]"),
        ("[set] [poss] (1.0)", "[fail]"),
        ("[set] [pos] 0 nan", "[fail]"),
        ("", "[fail]"),
        ("(1 2) 3", "[fail]"),
    ] {
        assert_eq!(asked(&mut axes, request, Carries::All).0, wanted, "{request}");
    }
    let (kind, _) = asked(&mut axes, "[get] [type] 1", Carries::All);
    assert!(kind.contains(&Vocab::new("atpr").0.to_string()), "{kind}");
    assert!(asked(&mut axes, "help", Carries::All).0.starts_with("[many] "));
}

#[test]
fn a_position_is_gone_to_at_the_speed_that_was_set_and_within_the_limits() {
    let mut axes = axes();
    assert_eq!(asked(&mut axes, "[set] [vel] 0 30.0", Carries::Positions).0, "[ok]");
    let (said, movement) = asked(&mut axes, "[set] [pos] 0 -180.0", Carries::Positions);
    let movement = movement.unwrap();
    assert_eq!((said.as_str(), movement.quantity), ("[ok]", Quantity::Position));
    assert_eq!((movement.joints, movement.values), (vec![0], vec![-FRAC_PI_2]));
    let (time, places) = movement.points.last().unwrap();
    assert_eq!(*places, [-FRAC_PI_2, 0.25], "the other joint stays");
    assert_eq!(*time, Duration::from_millis(4500), "135 degrees at 30 a second");
    // The first joint goes on at its own speed while the second one is commanded, and while that one is stopped.
    let (_, other) = asked(&mut axes, "[set] [pos] 1 0.35", Carries::Positions);
    let points = other.unwrap().points;
    let [(soon, between), (late, there)] = &points[..] else { panic!("{points:?}") };
    assert_eq!((there[0], *late), (-FRAC_PI_2, Duration::from_millis(4500)));
    assert_eq!((soon.as_millis(), between[1], there[1]), (1000, 0.35, 0.35));
    assert!((between[0] - 15_f64.to_radians()).abs() < 1e-9, "30 degrees in a second: {between:?}");
    let (_, stopped) = asked(&mut axes, "[set] [sto] 1", Carries::Positions);
    let points = stopped.unwrap().points;
    assert_eq!((points[0].1[0], points[0].1[1]), (PI / 4.0, 0.25));
    assert_eq!(points.last().unwrap().0, Duration::from_millis(4500));
    assert_eq!(asked(&mut axes, "[set] [vel] 0 0.0", Carries::Positions).0, "[fail]");
    assert_eq!(
        asked(&mut axes, "[get] [don] 0", Carries::All).0,
        "[is] [don] 0 [tsta] 7 12.5 [ok]"
    );
    let (_, relative) = asked(&mut axes, "[set] [relg] 2 (1 0) (0.5 -45.0)", Carries::All);
    assert_eq!(relative.unwrap().values, [0.75, 0.0]);
    let (_, stopped) = asked(&mut axes, "[set] [stos]", Carries::All);
    let stopped = stopped.unwrap();
    assert_eq!(stopped.points, [(Duration::ZERO, vec![PI / 4.0, 0.25])]);
}

#[test]
fn modes_are_kept_and_those_without_a_message_are_refused() {
    let mut axes = axes();
    for (request, carries, wanted) in [
        ("[set] [icmd] [cmod] 0 [posd]", Carries::Positions, "[ok]"),
        ("[set] [icmd] [cmod] 0 [vel]", Carries::Positions, "[fail]"),
        ("[set] [icmd] [cmod] 0 [vel]", Carries::All, "[ok]"),
        ("[set] [icmd] [cmds] ([pos] [fidl])", Carries::All, "[ok]"),
        ("[set] [icmd] [cmog] 1 (1) ([what])", Carries::All, "[fail]"),
        ("[set] [pos] 1 0.5", Carries::All, "[fail]"),
        ("[get] [icmd] [cmds]", Carries::All, "[is] [cmds] ([pos] [idl]) [tsta] 7 12.5 [ok]"),
    ] {
        assert_eq!(asked(&mut axes, request, carries).0, wanted, "{request}");
    }
}

#[test]
fn commands_are_those_that_remote_controlboard_streams() {
    let mut axes = axes();
    let mut taken = |text: &str, carries| command(&mut axes, &bottle(text), carries);
    let direct = taken("([dpo] 0) (90.0)", Carries::Positions).unwrap();
    assert_eq!((direct.values, direct.points[0].0), (vec![FRAC_PI_2], Duration::ZERO));
    let some = taken("([dpog] 2 (1 0)) (0.5 0.0)", Carries::Positions).unwrap();
    assert_eq!((some.joints, some.values), (vec![1, 0], vec![0.5, 0.0]));
    let all = taken("([poss]) (0.0 0.5)", Carries::Positions).unwrap();
    assert_eq!(all.points.last().unwrap().0, Duration::from_millis(4500));
    let turned = taken("([vmos]) (180.0 0.1)", Carries::All).unwrap();
    assert_eq!((turned.quantity, turned.values), (Quantity::Velocity, vec![PI, 0.1]));
    let pushed = taken("([dtq] 1) (3.5)", Carries::All).unwrap();
    assert_eq!((pushed.quantity, pushed.values), (Quantity::Effort, vec![3.5]));
    for (text, carries) in [
        ("([vmos]) (180.0 0.5)", Carries::Positions),
        ("([dpos]) (1.0)", Carries::All),
        ("([dpo] 5) (1.0)", Carries::All),
        ("([ipwm] [pwr] 0) (1.0)", Carries::All),
        ("1 2 3", Carries::All),
    ] {
        let why = taken(text, carries).unwrap_err();
        assert!(why.contains(text), "{why}");
    }
}

#[test]
fn a_state_without_a_joint_that_is_named_is_refused() {
    let options = YarpOptions { joints: vec!["pan".into()], ..YarpOptions::default() };
    let mut axes = Axes::new(&options);
    let state =
        |names: Vec<&'static str>, position| Joints { names, position, ..Joints::default() };
    let why = axes.take(&state(vec!["tilt"], vec![0.0]), &options).unwrap_err();
    assert!(why.contains("\"pan\"") && why.contains("tilt"), "{why}");
    assert!(!axes.is_known());
    assert!(axes.take(&state(vec!["pan"], vec![]), &options).is_err());
    axes.take(&state(vec!["tilt", "pan"], vec![0.0, 1.0]), &options).unwrap();
    assert!(axes.is_known());
    axes.take(&state(vec!["tilt"], vec![0.0]), &options).unwrap();
}

#[test]
fn joints_may_come_in_several_states() {
    let options =
        YarpOptions { joints: vec!["pan".into(), "grip".into()], ..YarpOptions::default() };
    let mut axes = Axes::new(&options);
    let state = |name, position| Joints {
        names: vec![name],
        position: vec![position],
        ..Joints::default()
    };
    assert!(axes.take(&state("pan", 1.0), &options).is_err());
    assert!(!axes.is_known());
    axes.take(&state("grip", 0.5), &options).unwrap();
    axes.take(&state("grip", 0.25), &options).unwrap();
    let told: Vec<f64> = axes.all().iter().map(|axis| axis.position.to_radians()).collect();
    assert!((told[0] - 1.0).abs() < 1e-9 && (told[1] - 0.25).abs() < 1e-9, "{told:?}");
    assert!(axes.is_known());
}

fn element() -> impl Strategy<Value = Value> {
    let words =
        ["get", "set", "pos", "poss", "posg", "rel", "icmd", "cmds", "cmog", "llim", "sto", "vel"];
    let leaf = prop_oneof![
        prop::sample::select(words.to_vec()).prop_map(Value::vocab),
        "[a-zA-Z\u{e4}]{0,5}".prop_map(Value::string),
        any::<i32>().prop_map(Value::Int32),
        (0..3).prop_map(Value::Int32),
        any::<f64>().prop_map(Value::Float64),
    ];
    leaf.prop_recursive(2, 16, 4, |inner| {
        prop::collection::vec(inner, 0..4).prop_map(|values| Value::List(Bottle { values }))
    })
}

proptest! {
    #[test]
    fn any_bottle_is_answered(values in prop::collection::vec(element(), 0..6)) {
        let mut axes = axes();
        let message = Bottle { values };
        let (answer, movement) = answer(&mut axes, &message, Carries::All, NOW);
        prop_assert!(!answer.values.is_empty());
        let moved = movement.or(command(&mut axes, &message, Carries::All).ok());
        if let Some(movement) = moved {
            prop_assert_eq!(movement.joints.len(), movement.values.len());
            prop_assert!(movement.points.iter().all(|(_, places)| places.len() == 2));
        }
    }
}
