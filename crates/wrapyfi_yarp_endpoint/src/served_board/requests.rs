//! Requests and commands of a control board's clients: `remote_controlboard`, `yarp rpc`, `yarpmotorgui`.
//!
//! ```text
//!   rpc:i      [set] [pos] 0 10.0                    ─▶ [ok]                            one axis
//!              [set] [poss] (10.0 20.0)              ─▶ [ok]                            all of them
//!              [set] [posg] 2 (0 1) (10.0 20.0)      ─▶ [ok]                            some
//!              [get] [enc] 0                         ─▶ [is] [enc] 9.5 [tsta] 7 1.7e9 [ok]
//!              anything that is not known here       ─▶ [fail]
//!   command:i  ([dpo] 0) (10.0)    ([poss]) (10.0 20.0)    ([vmog] 2 (0 1)) (1.0 2.0)
//! ```
//!
//! `RPCMessagesParser` and `StreamingMessagesParser` of YARP 3 are the specification. A word has three letters and the
//! extent behind them: none for one axis, `s` for all, `g` for a list.

use std::str::FromStr as _;

use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::sig::Stamp;
use wrapyfi_yarp::{Bottle, Value};

use super::axes::{Axes, Axis, Mode, Movement, Quantity};

/// Version of the protocol that `remote_controlboard` of YARP 3 asks for.
const PROTOCOL: [i32; 3] = [1, 9, 0];
/// Answer to `help`.
const HELP: &[&str] = &[
    "Control board of a robot in ROS 2:",
    "[get] [axes]",
    "[get] [name] axis, [type], [llim], [enc], [esp], [pos], [vel], [don]",
    "[get] [encs], [esps], [poss], [vels], [dons]",
    "[set] [pos] axis position, [rel], [vel], [sto]",
    "[set] [poss] (positions), [rels], [vels], [stos]",
    "[get] [icmd] [cmod] axis, [set] [icmd] [cmod] axis [pos]",
];

/// Quantities that the messages of ROS carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Carries {
    /// Positions alone: `JointTrajectory`.
    Positions,
    /// Positions, velocities, efforts: `JointState`.
    All,
}

impl Carries {
    fn mode(self, mode: Mode) -> bool {
        self == Self::All || !matches!(mode, Mode::Velocity | Mode::Torque)
    }
}

/// Result of a request: the words before `[ok]`, and the movement that it asks for. `None` is `[fail]`.
type Answered = Option<(Vec<Value>, Option<Movement>)>;

/// Answers a request.
pub(super) fn answer(
    axes: &mut Axes,
    request: &Bottle,
    carries: Carries,
    now: Stamp,
) -> (Bottle, Option<Movement>) {
    if request.values.first().is_some_and(|word| word.is_word("help")) {
        let lines = HELP.iter().map(|line| Value::string(*line));
        let values = std::iter::once(Value::vocab("many")).chain(lines).collect();
        return (Bottle { values }, None);
    }
    let answered = match (word(request.values.first()).as_str(), request.values.get(1..)) {
        ("get", Some([what, rest @ ..])) => {
            get(axes, what, rest).map(|words| (stamped(words, what, now), None))
        }
        ("set", Some([what, rest @ ..])) => set(axes, what, rest, carries),
        _ => None,
    };
    let (mut values, movement) = answered.unwrap_or((vec![Value::Vocab32(Vocab::FAIL)], None));
    if values.first() != Some(&Value::Vocab32(Vocab::FAIL)) {
        values.push(Value::Vocab32(Vocab::OK));
    }
    (Bottle { values }, movement)
}

/// Reads a command: its head, and its numbers.
///
/// # Errors
/// The command in words, where it is none that this board takes.
pub(super) fn command(
    axes: &mut Axes,
    message: &Bottle,
    carries: Carries,
) -> Result<Movement, String> {
    let refused = || format!("no command that this board takes: {}", message.to_text());
    let [Value::List(head), Value::List(body)] = message.values.as_slice() else {
        return Err(refused());
    };
    let values = body.into_iter().map(Value::as_f64).collect::<Option<Vec<f64>>>();
    let moved = (|| {
        let word = word(head.values.first());
        let (stem, joints, rest) = select(&word, head.values.get(1..)?, axes.all().len())?;
        let (values, is_read) = (values?, rest.is_empty());
        match stem {
            _ if !is_read => None,
            "pos" => axes.move_to(&joints, &values, false),
            "dpo" => axes.move_to(&joints, &values, true),
            "vmo" if carries == Carries::All => axes.drive(Quantity::Velocity, &joints, &values),
            "dtq" if carries == Carries::All => axes.drive(Quantity::Effort, &joints, &values),
            _ => None,
        }
    })();
    moved.ok_or_else(refused)
}

/// The answer to `[get]`, without `[is]` and what was asked for.
fn get(axes: &Axes, what: &Value, rest: &[Value]) -> Option<Vec<Value>> {
    let all = axes.all();
    let count = i32::try_from(all.len()).ok()?;
    let one = || all.get(usize::try_from(rest.first()?.as_i64()?).ok()?);
    let pair = |(least, most): (f64, f64)| Some(vec![least.into(), most.into()]);
    match word(Some(what)).as_str() {
        "prot" => return Some(PROTOCOL.map(Value::Int32).into()),
        "axes" | "mtnm" => return Some(vec![count.into()]),
        "name" => return Some(vec![Value::string(one()?.name.as_str())]),
        "type" => {
            let Vocab(code) = Vocab::new(if one()?.slides { "atpr" } else { "atrv" });
            return Some(vec![code.into()]);
        }
        "llim" => return pair(one()?.range),
        "vlim" => return pair((0.0, one()?.speed.max(100.0))),
        "icmd" => return modes(all, rest, "cmod", "cmds", "cmog", |axis| axis.mode.word()),
        "intm" => return modes(all, rest, "mode", "mods", "modg", |_| "stif"),
        _ => {}
    }
    let word = word(Some(what));
    let (stem, joints, rest) = select(&word, rest, all.len())?;
    if !rest.is_empty() {
        return None;
    }
    let chosen = joints.iter().filter_map(|&joint| all.get(joint));
    if stem == "don" {
        return Some(vec![i32::from(chosen.clone().all(Axis::has_arrived)).into()]);
    }
    let number = |axis: &Axis| {
        Some(match stem {
            "enc" | "mnc" => axis.position,
            "esp" | "msp" => axis.velocity,
            "eac" | "mac" => 0.0,
            "pos" | "dpo" => axis.target,
            "vmo" => axis.wanted_velocity,
            "vel" => axis.speed,
            "acc" => axis.acceleration,
            _ => return None,
        })
    };
    let numbers =
        chosen.map(|axis| number(axis).map(Value::Float64)).collect::<Option<Vec<_>>>()?;
    Some(match word.len() {
        3 => numbers,
        _ => vec![Value::List(Bottle { values: numbers })],
    })
}

/// Words that one axis, all of them or some have: `[cmod] 0`, `[cmds]`, `[cmog] 2 (0 1)`.
fn modes(
    all: &[Axis],
    request: &[Value],
    one: &str,
    every: &str,
    some: &str,
    of: impl Fn(&Axis) -> &'static str,
) -> Option<Vec<Value>> {
    let (extent, rest) = request.split_first()?;
    let mode = |axis| Value::vocab(of(axis));
    let list = |joints: Vec<usize>| {
        let words = joints.into_iter().map(|joint| all.get(joint).map(mode));
        let values = words.collect::<Option<Vec<Value>>>()?;
        Some(vec![extent.clone(), Value::List(Bottle { values })])
    };
    match word(Some(extent)) {
        word if word == one => {
            let joint = rest.first()?.as_i64()?;
            let axis = all.get(usize::try_from(joint).ok()?)?;
            Some(vec![Value::Int32(joint.try_into().ok()?), mode(axis)])
        }
        word if word == every => list((0..all.len()).collect()),
        word if word == some => list(listed(rest, all.len())?.0),
        _ => None,
    }
}

/// `[is]` before an answer, and the time behind it.
fn stamped(words: Vec<Value>, what: &Value, now: Stamp) -> Vec<Value> {
    // The version has neither; modes are told without the name of their interface.
    let (lead, is_timed) = match word(Some(what)).as_str() {
        "prot" => (vec![what.clone()], false),
        "icmd" | "intm" => (vec![Value::vocab("is")], true),
        _ => (vec![Value::vocab("is"), what.clone()], true),
    };
    let time = [Value::vocab("tsta"), now.count.into(), now.time_s.into()];
    lead.into_iter().chain(words).chain(time.into_iter().filter(|_| is_timed)).collect()
}

/// Does what `[set]` asks for.
fn set(axes: &mut Axes, what: &Value, rest: &[Value], carries: Carries) -> Answered {
    let done = Some((Vec::new(), None));
    let count = axes.all().len();
    match word(Some(what)).as_str() {
        "icmd" => return set_modes(axes, rest, carries).and(done),
        "llim" => {
            let [joint, least, most] = rest else { return None };
            let range = (least.as_f64()?, most.as_f64()?);
            let axis = axes.get_mut(usize::try_from(joint.as_i64()?).ok()?)?;
            axis.bound(Some(range).filter(|(least, most)| least < most)?);
            return done;
        }
        _ => {}
    }
    let word = word(Some(what));
    let (stem, joints, rest) = select(&word, rest, count)?;
    let values = || match (word.len(), rest) {
        (3, [value]) => Some(vec![value.as_f64()?]),
        (4, [Value::List(list)]) => list.into_iter().map(Value::as_f64).collect(),
        _ => None,
    };
    let moved = match stem {
        "pos" => axes.move_to(&joints, &values()?, false),
        "dpo" => axes.move_to(&joints, &values()?, true),
        "rel" => {
            let here = joints.iter().filter_map(|&joint| axes.all().get(joint));
            let targets = here.zip(values()?).map(|(axis, by)| axis.position + by);
            let targets: Vec<f64> = targets.collect();
            axes.move_to(&joints, &targets, false)
        }
        "vmo" if carries == Carries::All => axes.drive(Quantity::Velocity, &joints, &values()?),
        "sto" if rest.is_empty() => axes.stop(&joints),
        "vel" | "acc" => {
            let values = values().filter(|it| it.len() == joints.len())?;
            // An axis without speed would arrive at once, or never.
            if values.iter().any(|it| !it.is_finite() || *it <= 0.0) {
                return None;
            }
            for (joint, value) in joints.into_iter().zip(values) {
                let axis = axes.get_mut(joint)?;
                *(if stem == "vel" { &mut axis.speed } else { &mut axis.acceleration }) = value;
            }
            return done;
        }
        _ => None,
    };
    moved.map(|movement| (Vec::new(), Some(movement)))
}

/// Sets modes of axes; `None` where one is not known, or has no form in the message of ROS.
fn set_modes(axes: &mut Axes, request: &[Value], carries: Carries) -> Option<()> {
    let (extent, rest) = request.split_first()?;
    let count = axes.all().len();
    let (joints, words): (Vec<usize>, Vec<Value>) = match (word(Some(extent)).as_str(), rest) {
        ("cmod", [joint, mode]) => (vec![place(joint, count)?], vec![mode.clone()]),
        ("cmds", [Value::List(modes)]) => ((0..count).collect(), modes.values.clone()),
        ("cmog", _) => match listed(rest, count)? {
            (joints, [Value::List(modes)]) => (joints, modes.values.clone()),
            _ => return None,
        },
        _ => return None,
    };
    let modes = words.iter().map(|it| Mode::from_str(&word(Some(it))).ok());
    let modes = modes.collect::<Option<Vec<Mode>>>()?;
    if modes.len() != joints.len() || !modes.iter().all(|mode| carries.mode(*mode)) {
        return None;
    }
    for (joint, mode) in joints.into_iter().zip(modes) {
        axes.get_mut(joint)?.mode = mode;
    }
    Some(())
}

/// The first letters of a word, the axes that it means, and what stands behind these.
fn select<'w, 'v>(
    word: &'w str,
    rest: &'v [Value],
    count: usize,
) -> Option<(&'w str, Vec<usize>, &'v [Value])> {
    let (stem, extent) = word.split_at_checked(3)?;
    match extent {
        "" => {
            let (joint, rest) = rest.split_first()?;
            Some((stem, vec![place(joint, count)?], rest))
        }
        "s" => Some((stem, (0..count).collect(), rest)),
        "g" => listed(rest, count).map(|(joints, rest)| (stem, joints, rest)),
        _ => None,
    }
}

/// The axes of `2 (0 1) …`, and what stands behind them.
fn listed(rest: &[Value], count: usize) -> Option<(Vec<usize>, &[Value])> {
    let [number, Value::List(list), rest @ ..] = rest else { return None };
    let joints = list.into_iter().map(|joint| place(joint, count));
    let joints = joints.collect::<Option<Vec<usize>>>()?;
    (usize::try_from(number.as_i64()?).ok()? == joints.len()).then_some((joints, rest))
}

fn place(joint: &Value, count: usize) -> Option<usize> {
    usize::try_from(joint.as_i64()?).ok().filter(|&joint| joint < count)
}

/// The letters of a word, which comes as a vocab or, typed without brackets, as a string; empty for anything else.
fn word(value: Option<&Value>) -> String {
    match value {
        Some(Value::Vocab32(vocab)) => String::from_utf8_lossy(&vocab.letters()).into_owned(),
        Some(value) => value.as_str().unwrap_or_default().to_owned(),
        None => String::new(),
    }
}

#[cfg(test)]
#[path = "requests_tests.rs"]
mod tests;
