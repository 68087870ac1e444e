//! Trajectories: joint positions and velocities over time, with events.

use std::fmt;
use std::str::FromStr;

use super::section::Section;
use super::timing::differences;
use crate::error::{Error, Result, check_finite, check_length};
use crate::tolerance::{JOIN_POSITION, JOIN_VELOCITY};

/// What kind of thing happened. Its words are the same in Rust, Python, files and messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum EventKind {
    /// The reduced gradient chose other dependent joints.
    BasisChange,
    /// Damping was switched on near a singularity.
    Damping,
    /// A limit became active or inactive.
    Limit,
    /// The task velocity was scaled down.
    Scaled,
    /// The Jacobian lost rank.
    KinematicSingularity,
    /// The optimum changed its kind.
    AlgorithmicSingularity,
    /// The arm changed its branch, or moved while the tool stood still.
    Reconfiguration,
    /// A joint met its position limit.
    JointLimit,
    /// A limit or a barrier began to shape the motion.
    LimitActive,
    /// A limit or a barrier that shaped the motion no longer does.
    LimitReleased,
    /// The arm touches an obstacle or itself.
    Contact,
    /// A speed limit of a joint bounds the speed along the path or the motion of the freedom.
    SpeedBounded,
}

impl EventKind {
    /// Every kind, in declaration order.
    pub const ALL: [Self; 12] = [
        Self::BasisChange,
        Self::Damping,
        Self::Limit,
        Self::Scaled,
        Self::KinematicSingularity,
        Self::AlgorithmicSingularity,
        Self::Reconfiguration,
        Self::JointLimit,
        Self::LimitActive,
        Self::LimitReleased,
        Self::Contact,
        Self::SpeedBounded,
    ];

    /// The kind as a word in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::BasisChange => "basis_change",
            Self::Damping => "damping",
            Self::Limit => "limit",
            Self::Scaled => "scaled",
            Self::KinematicSingularity => "kinematic_singularity",
            Self::AlgorithmicSingularity => "algorithmic_singularity",
            Self::Reconfiguration => "reconfiguration",
            Self::JointLimit => "joint_limit",
            Self::LimitActive => "limit_active",
            Self::LimitReleased => "limit_released",
            Self::Contact => "contact",
            Self::SpeedBounded => "speed_bounded",
        }
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for EventKind {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == word).ok_or_else(|| Error::UnknownName {
            kind: "event kind",
            name: word.into(),
            valid: Self::ALL.map(|kind| kind.as_str().to_owned()).to_vec(),
        })
    }
}

/// Something that happened on the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// What kind of thing.
    pub kind: EventKind,
    /// Row of the trajectory, from 0; where a plan ends early, the path point that was not reached.
    pub index: usize,
    /// Time, s.
    pub t: f64,
    /// Arc length on the path, m (on a self-motion its parameter).
    pub s: f64,
    /// What happened, for a person.
    pub message: String,
}

/// Joint positions and velocities over time, one row per instant.
///
/// ```
/// use redundancy_core::path::Trajectory;
/// let names = ["shoulder", "elbow"].map(String::from).to_vec();
/// let t = vec![0.0, 0.5, 1.0];
/// let q = vec![0.0, 1.0, 0.5, 1.0, 1.0, 1.0];
/// let trajectory = Trajectory::new(names, t, q, None, Vec::new())?;
/// assert_eq!(trajectory.rows(), 3);
/// assert_eq!(trajectory.qd_row(1), [1.0, 0.0]);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    joint_names: Vec<String>,
    t: Vec<f64>,
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Option<Vec<f64>>,
    sections: Option<Vec<Section>>,
    events: Vec<Event>,
}

impl Trajectory {
    /// `q` and `qd` hold the rows one after the other, one entry per joint; without `qd` the velocities are
    /// differences of `q` (second order inside, first order at the ends).
    ///
    /// # Errors
    /// No joint, a joint name that is empty or used twice, lengths that do not match, numbers that are not finite,
    /// times that do not increase.
    pub fn new(
        joint_names: Vec<String>,
        t: Vec<f64>,
        q: Vec<f64>,
        qd: Option<Vec<f64>>,
        events: Vec<Event>,
    ) -> Result<Self> {
        if joint_names.is_empty() {
            return Err(Error::Length { what: "joint names".into(), expected: 1, actual: 0 });
        }
        for (i, name) in joint_names.iter().enumerate() {
            if name.is_empty() {
                return Err(Error::Invalid(format!("joint {i} has an empty name")));
            }
            if joint_names[..i].contains(name) {
                return Err(Error::Invalid(format!("joint name '{name}' is used twice")));
            }
        }
        check_finite("t", &t)?;
        if let Some(i) = (1..t.len()).find(|i| t[*i] <= t[*i - 1]) {
            return Err(Error::Invalid(format!(
                "t[{i}] is {} after {}, times must increase",
                t[i],
                t[i - 1]
            )));
        }
        let entries = t.len() * joint_names.len();
        check_length("q", &q, entries)?;
        check_finite("q", &q)?;
        let qd = match qd {
            None => {
                let qd = differences(&t, &q, joint_names.len());
                if let Some(i) = qd.iter().position(|v| !v.is_finite()) {
                    let (row, joint) = (i / joint_names.len(), &joint_names[i % joint_names.len()]);
                    return Err(Error::Invalid(format!(
                        "joint '{joint}' moves too far in too short a time at row {row}: its speed is not finite"
                    )));
                }
                qd
            }
            Some(qd) => {
                check_length("qd", &qd, entries)?;
                check_finite("qd", &qd)?;
                qd
            }
        };
        for event in &events {
            check_finite("event", &[event.t, event.s])?;
            // One past the end is the point that a plan which ends early did not reach.
            if event.index > t.len() {
                return Err(Error::Invalid(format!(
                    "an event has index {}, the trajectory has only {} rows",
                    event.index,
                    t.len()
                )));
            }
        }
        Ok(Self { joint_names, t, q, qd, qdd: None, sections: None, events })
    }

    /// The same rows with their accelerations, one entry per joint: between rows the motion is then a quintic polynomial,
    /// see [`sample`](Self::sample).
    ///
    /// # Errors
    /// A length that does not match, numbers that are not finite.
    pub fn with_accelerations(self, qdd: Vec<f64>) -> Result<Self> {
        check_length("qdd", &qdd, self.q.len())?;
        check_finite("qdd", &qdd)?;
        Ok(Self { qdd: Some(qdd), ..self })
    }

    /// The same rows, each with the part of the motion to which it belongs.
    ///
    /// # Errors
    /// Not one section per row.
    pub fn with_sections(self, sections: Vec<Section>) -> Result<Self> {
        let (expected, actual) = (self.rows(), sections.len());
        if expected != actual {
            return Err(Error::Length { what: "section".into(), expected, actual });
        }
        Ok(Self { sections: Some(sections), ..self })
    }

    /// This motion and then another that begins where it ends: its last row is the first of the other, whose times follow.
    ///
    /// ```
    /// use redundancy_core::path::Trajectory;
    /// let part = |t: [f64; 2], q: [f64; 2]| {
    ///     Trajectory::new(vec!["joint".into()], t.to_vec(), q.to_vec(), Some(vec![0.0; 2]), Vec::new())
    /// };
    /// let whole = part([0.0, 1.0], [0.0, 0.5])?.joined(&part([0.0, 2.0], [0.5, 0.0])?)?;
    /// assert_eq!((whole.t(), whole.q()), (&[0.0, 1.0, 3.0][..], &[0.0, 0.5, 0.0][..]));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// Other joints; positions or velocities that differ where the two meet: joint and both values.
    pub fn joined(&self, other: &Self) -> Result<Self> {
        let n = self.dof();
        if self.joint_names != other.joint_names {
            let message = format!(
                "the joints of the two motions differ: {} and {}",
                self.joint_names.join(", "),
                other.joint_names.join(", ")
            );
            return Err(Error::Invalid(message));
        }
        let (Some(end), Some(start)) = (self.t.last(), other.t.first()) else {
            return Ok(if self.t.is_empty() { other.clone() } else { self.clone() });
        };
        let meet = |what: &str, own: &[f64], its: &[f64], tolerance: f64| -> Result<()> {
            let own = &own[own.len() - n..];
            match (0..n).find(|j| (own[*j] - its[*j]).abs() > tolerance) {
                None => Ok(()),
                Some(j) => Err(Error::Invalid(format!(
                    "the {what} of joint '{}' is {} at the end of the first motion and {} at the start of the second",
                    self.joint_names[j], own[j], its[j]
                ))),
            }
        };
        meet("position", &self.q, &other.q, JOIN_POSITION)?;
        meet("velocity", &self.qd, &other.qd, JOIN_VELOCITY)?;
        let (shift, rows) = (end - start, self.rows());
        let both = |own: &[f64], its: &[f64]| [own, &its[n..]].concat();
        let sections = |of: &Self| of.sections.clone().unwrap_or_else(|| vec![Section::Path; of.rows()]);
        let events = other.events.iter().map(|event| Event {
            index: event.index + rows - 1,
            t: event.t + shift,
            ..event.clone()
        });
        Ok(Self {
            joint_names: self.joint_names.clone(),
            t: self.t.iter().copied().chain(other.t[1..].iter().map(|t| t + shift)).collect(),
            q: both(&self.q, &other.q),
            qd: both(&self.qd, &other.qd),
            // Accelerations only where both have them: else the interpolation of one of them would change.
            qdd: self.qdd.as_ref().zip(other.qdd.as_ref()).map(|(own, its)| both(own, its)),
            sections: (self.sections.is_some() || other.sections.is_some())
                .then(|| [sections(self), sections(other)[1..].to_vec()].concat()),
            events: self.events.iter().cloned().chain(events).collect(),
        })
    }

    /// The joints' names, base to tip.
    pub fn joint_names(&self) -> &[String] {
        &self.joint_names
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.joint_names.len()
    }

    /// Number of instants.
    pub fn rows(&self) -> usize {
        self.t.len()
    }

    /// Times, s.
    pub fn t(&self) -> &[f64] {
        &self.t
    }

    /// Joint positions row by row, rad or m.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Joint velocities row by row, rad/s or m/s.
    pub fn qd(&self) -> &[f64] {
        &self.qd
    }

    /// Joint accelerations row by row, rad/s^2 or m/s^2, where the trajectory carries them.
    pub fn qdd(&self) -> Option<&[f64]> {
        self.qdd.as_deref()
    }

    /// The part of the motion to which each row belongs, where the trajectory says so.
    pub fn sections(&self) -> Option<&[Section]> {
        self.sections.as_deref()
    }

    /// Joint positions at one instant; empty past the end.
    pub fn q_row(&self, i: usize) -> &[f64] {
        self.q.chunks_exact(self.dof()).nth(i).unwrap_or_default()
    }

    /// Joint velocities at one instant; empty past the end.
    pub fn qd_row(&self, i: usize) -> &[f64] {
        self.qd.chunks_exact(self.dof()).nth(i).unwrap_or_default()
    }

    /// What happened on the way, in order.
    pub fn events(&self) -> &[Event] {
        &self.events
    }
}
