//! Axes of a board: what they do, what they shall do, and the movements that follow from it.
//!
//! ```text
//!   JointState ─▶ Axes::take ─▶ position, velocity, effort
//!   command    ─▶ Axes::move_to, turn_at, push_with, stop ─▶ Movement, in the units of ROS
//! ```
//!
//! All numbers inside are in YARP's units: degrees for axes that turn, metres for those that slide.

use std::time::{Duration, Instant};

use super::super::joint_limits::Range;
use super::super::options::YarpOptions;

/// Distance from its target, in degrees or metres, below which an axis has arrived.
const ARRIVED: [f64; 2] = [0.5, 0.005];
/// Speed in degrees or metres a second of position moves, until a client sets another.
const SPEED: [f64; 2] = [10.0, 0.1];
/// Acceleration that is told until a client sets another; nothing here accelerates.
const ACCELERATION: f64 = 100.0;
/// Age of the last state from which on movements are refused: the robot does not say where it is any more.
const STALE: Duration = Duration::from_secs(2);
/// Range of an axis that turns, where option `limits` has none: sliders of a user interface need ends.
const TURN: Range = (-180.0, 180.0);
/// The same of an axis that slides, in metres.
const SLIDE: Range = (-1.0, 1.0);

/// Mode of an axis, as clients set and read it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumString, strum::IntoStaticStr)]
pub(super) enum Mode {
    /// The axis takes no movement.
    #[strum(serialize = "idl", serialize = "fidl")]
    Idle,
    /// Targets are gone to at the axis's speed.
    #[strum(serialize = "pos")]
    Position,
    /// Targets are taken at once.
    #[strum(serialize = "posd")]
    PositionDirect,
    /// Velocities.
    #[strum(serialize = "vel")]
    Velocity,
    /// Positions and velocities.
    #[strum(serialize = "mix")]
    Mixed,
    /// Torques or forces.
    #[strum(serialize = "torq")]
    Torque,
}

impl Mode {
    /// The word of the mode.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Idle => "idl",
            other => other.into(),
        }
    }
}

/// One axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    pub(super) name: String,
    pub(super) slides: bool,
    /// Least and greatest position.
    pub(super) range: Range,
    /// True where the range was given, so that targets are kept inside.
    is_bounded: bool,
    pub(super) position: f64,
    pub(super) velocity: f64,
    pub(super) effort: f64,
    pub(super) target: f64,
    /// Velocity that was asked for last.
    pub(super) wanted_velocity: f64,
    pub(super) speed: f64,
    pub(super) acceleration: f64,
    pub(super) mode: Mode,
    /// Time of the last state that told its position.
    told: Option<Instant>,
}

impl Axis {
    pub(super) fn has_arrived(&self) -> bool {
        (self.target - self.position).abs() <= self.of_kind(ARRIVED)
    }

    fn of_kind(&self, [turning, sliding]: [f64; 2]) -> f64 {
        if self.slides { sliding } else { turning }
    }

    /// Sets the range, in which targets are kept from now on.
    pub(super) fn bound(&mut self, range: Range) {
        (self.range, self.is_bounded) = (range, true);
    }
}

/// Quantity that a movement demands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Position,
    Velocity,
    Effort,
}

/// A movement for ROS: radians, metres, newtons.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Movement {
    pub(super) quantity: Quantity,
    /// Places of the axes that move.
    pub(super) joints: Vec<usize>,
    /// A number for each of these.
    pub(super) values: Vec<f64>,
    /// Places of all axes from now on, each at its time: one point for each time at which an axis arrives, the other
    /// axes on their way at their own speeds.
    pub(super) points: Vec<(Duration, Vec<f64>)>,
}

/// Numbers of all joints in a `JointState`, in its order and the units of ROS.
#[derive(Debug, Clone, Default)]
pub(super) struct Joints<'a> {
    pub(super) names: Vec<&'a str>,
    pub(super) position: Vec<f64>,
    pub(super) velocity: Vec<f64>,
    pub(super) effort: Vec<f64>,
}

/// The axes of a board.
#[derive(Debug, Default)]
pub(super) struct Axes {
    all: Vec<Axis>,
    in_degrees: bool,
}

impl Axes {
    /// The axes that option `joints` names; none where it is left out, so that the first state names them.
    pub(super) fn new(options: &YarpOptions) -> Self {
        let mut axes = Self { in_degrees: options.degrees, all: Vec::new() };
        axes.name(options.joints.iter().map(String::as_str), options);
        axes
    }

    fn name<'a>(&mut self, names: impl Iterator<Item = &'a str>, options: &YarpOptions) {
        let axis = |name: &str| {
            let slides = options.prismatic.iter().any(|one| one == name);
            let given = options.ranges.get(name).copied();
            let axis = Axis {
                name: name.to_owned(),
                slides,
                range: given.unwrap_or(if slides { SLIDE } else { TURN }),
                is_bounded: given.is_some(),
                position: 0.0,
                velocity: 0.0,
                effort: 0.0,
                target: 0.0,
                wanted_velocity: 0.0,
                speed: 0.0,
                acceleration: ACCELERATION,
                mode: Mode::Position,
                told: None,
            };
            Axis { speed: axis.of_kind(SPEED), ..axis }
        };
        self.all = names.map(axis).collect();
    }

    pub(super) fn all(&self) -> &[Axis] {
        &self.all
    }

    pub(super) fn get_mut(&mut self, joint: usize) -> Option<&mut Axis> {
        self.all.get_mut(joint)
    }

    /// True once names and places of the axes are known.
    pub(super) fn is_known(&self) -> bool {
        self.silent_for().is_some()
    }

    /// Age of the state of the axis that was told longest ago; `None` before each has one.
    pub(super) fn silent_for(&self) -> Option<Duration> {
        let oldest = self.all.iter().map(|axis| axis.told).min()?;
        oldest.map(|at| at.elapsed())
    }

    /// Takes a state of the robot, which may have some of the joints. Those that are not of this board are passed over: one
    /// `/joint_states` has those of all boards, and several nodes may publish on it.
    ///
    /// # Errors
    /// The joints of the board that no state has told yet, or the numbers that do not belong to the names.
    pub(super) fn take(&mut self, state: &Joints<'_>, options: &YarpOptions) -> Result<(), String> {
        let Joints { names, position, velocity, effort } = state;
        if names.len() != position.len() {
            return Err(format!("{} names and {} positions", names.len(), position.len()));
        }
        if self.all.is_empty() {
            self.name(names.iter().copied(), options);
        }
        let place = |axis: &Axis| names.iter().position(|name| *name == axis.name);
        let places: Vec<Option<usize>> = self.all.iter().map(place).collect();
        let now = Instant::now();
        for joint in 0..self.all.len() {
            let Some(at) = places.get(joint).copied().flatten() else { continue };
            let number = |list: &[f64]| list.get(at).copied().filter(|it| it.is_finite());
            let [position, velocity] =
                [position, velocity].map(|list| number(list).map(|it| self.to_yarp(joint, it)));
            let effort = number(effort);
            let Some(axis) = self.all.get_mut(joint) else { continue };
            axis.position = position.unwrap_or(axis.position);
            axis.velocity = velocity.unwrap_or(0.0);
            axis.effort = effort.unwrap_or(0.0);
            if axis.told.replace(now).is_none() {
                axis.target = axis.position;
            }
        }
        match self.all.iter().find(|axis| axis.told.is_none()) {
            Some(missing) => Err(format!(
                "no joint {:?}, which option joints names; those that move are {}",
                missing.name,
                names.join(", ")
            )),
            None => Ok(()),
        }
    }

    /// Moves axes to `targets`: at their speeds, which the slowest decides, or at once. `None` where one of them is idle,
    /// or a number is none.
    pub(super) fn move_to(
        &mut self,
        joints: &[usize],
        targets: &[f64],
        at_once: bool,
    ) -> Option<Movement> {
        self.check(joints, targets)?;
        for (&joint, &target) in joints.iter().zip(targets) {
            let axis = self.all.get_mut(joint)?;
            let (least, most) = axis.range;
            axis.target = if axis.is_bounded { target.clamp(least, most) } else { target };
        }
        let values = joints.iter().filter_map(|&joint| self.all.get(joint).map(|axis| axis.target));
        let values = values.collect();
        Some(self.movement(Quantity::Position, joints, values, at_once))
    }

    /// Stops axes where they are.
    pub(super) fn stop(&mut self, joints: &[usize]) -> Option<Movement> {
        let here: Vec<f64> =
            joints.iter().filter_map(|&joint| self.all.get(joint).map(|it| it.position)).collect();
        self.move_to(joints, &here, true)
    }

    /// Moves axes at `velocities`, or with `efforts`. `None` as for [`Axes::move_to`].
    pub(super) fn drive(
        &mut self,
        quantity: Quantity,
        joints: &[usize],
        values: &[f64],
    ) -> Option<Movement> {
        self.check(joints, values)?;
        if quantity == Quantity::Velocity {
            for (&joint, &value) in joints.iter().zip(values) {
                self.all.get_mut(joint)?.wanted_velocity = value;
            }
        }
        Some(self.movement(quantity, joints, values.to_vec(), true))
    }

    fn check(&self, joints: &[usize], values: &[f64]) -> Option<()> {
        let moves = |&joint: &usize| self.all.get(joint).is_some_and(|it| it.mode != Mode::Idle);
        let is_there = self.silent_for().is_some_and(|age| age < STALE);
        let fits = is_there && joints.len() == values.len() && !joints.is_empty();
        (fits && joints.iter().all(moves) && values.iter().all(|it| it.is_finite())).then_some(())
    }

    fn movement(
        &self,
        quantity: Quantity,
        joints: &[usize],
        mut values: Vec<f64>,
        at_once: bool,
    ) -> Movement {
        if quantity != Quantity::Effort {
            for (value, &joint) in values.iter_mut().zip(joints) {
                *value = self.to_ros(joint, *value);
            }
        }
        // Seconds that each axis has to its target; those that this movement does not name go on.
        let times: Vec<f64> = self
            .all
            .iter()
            .enumerate()
            .map(|(joint, axis)| {
                let is_there = at_once && joints.contains(&joint);
                if is_there { 0.0 } else { (axis.target - axis.position).abs() / axis.speed }
            })
            .collect();
        let mut arrivals = times.clone();
        arrivals.sort_by(f64::total_cmp);
        arrivals.dedup();
        let at = |time_s: f64| {
            let all = self.all.iter().zip(&times).enumerate();
            let place = |(joint, (axis, &arrival)): (usize, (&Axis, &f64))| {
                let part = if arrival > time_s { time_s / arrival } else { 1.0 };
                self.to_ros(joint, axis.position + (axis.target - axis.position) * part)
            };
            Some((Duration::try_from_secs_f64(time_s).ok()?, all.map(place).collect()))
        };
        let points = arrivals.into_iter().filter_map(at).collect();
        Movement { quantity, joints: joints.to_vec(), values, points }
    }

    fn turns(&self, joint: usize) -> bool {
        self.in_degrees && self.all.get(joint).is_some_and(|axis| !axis.slides)
    }

    fn to_ros(&self, joint: usize, value: f64) -> f64 {
        if self.turns(joint) { value.to_radians() } else { value }
    }

    fn to_yarp(&self, joint: usize, value: f64) -> f64 {
        if self.turns(joint) { value.to_degrees() } else { value }
    }
}
