//! What comes out: joint positions and velocities over time, and what happened on the way.

use std::fmt;
use std::path::Path as FilePath;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::section::Section;
use super::table::{self, Table};
use super::timing::differences;
use crate::error::{Error, Result, check_finite, check_length};

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
}

impl EventKind {
    /// Every kind, in declaration order.
    pub const ALL: [Self; 8] = [
        Self::BasisChange,
        Self::Damping,
        Self::Limit,
        Self::Scaled,
        Self::KinematicSingularity,
        Self::AlgorithmicSingularity,
        Self::Reconfiguration,
        Self::JointLimit,
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

    /// Writes `t,<joint>...,<joint>_velocity...`, one line per instant; `<joint>_acceleration...` and `section` follow where
    /// the trajectory has them. Events are not part of it.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn to_csv(&self, file: impl AsRef<FilePath>) -> Result<()> {
        let header = header(&self.joint_names, self.qdd.is_some(), self.sections.is_some());
        let n = self.dof();
        let rows = (0..self.rows()).map(|i| {
            let mut row = vec![self.t[i]];
            row.extend(self.q_row(i));
            row.extend(self.qd_row(i));
            row.extend(self.qdd.iter().flat_map(|qdd| &qdd[i * n..(i + 1) * n]));
            let word = self.sections.iter().map(|sections| sections[i].to_string());
            row.iter().map(f64::to_string).chain(word).collect()
        });
        table::write_records(file.as_ref(), &header, rows)
    }

    /// Reads what [`to_csv`](Self::to_csv) writes.
    ///
    /// # Errors
    /// A file that cannot be read, a header of another form, fields that are no finite numbers, times that do not
    /// increase: with the file's name and line.
    pub fn from_csv(file: impl AsRef<FilePath>) -> Result<Self> {
        let table = Table::read_with_words(file.as_ref(), SECTION)?;
        let columns = table.header.len().saturating_sub(1);
        let form = [2, 3].into_iter().find_map(|kinds| {
            let names = table.header.get(1..=columns / kinds)?;
            (!names.is_empty() && header(names, kinds == 3, false) == table.header)
                .then(|| (kinds, names.to_vec()))
        });
        let Some((kinds, names)) = form else {
            let message = format!(
                "the header is '{}', expected t, the joint names, the joint names with {VELOCITY} and, where there are \
                 accelerations, with {ACCELERATION}",
                table.header.join(",")
            );
            return Err(table.error(table.header_line, message));
        };
        if let Some(i) = (1..table.rows.len()).find(|i| table.rows[*i].1[0] <= table.rows[*i - 1].1[0]) {
            let (now, before) = (table.rows[i].1[0], table.rows[i - 1].1[0]);
            return Err(table.error(table.rows[i].0, format!("t is {now} after {before}, it must increase")));
        }
        let sections = table.words.iter().flatten().zip(&table.rows).map(|(word, (line, _))| {
            word.parse::<Section>().map_err(|error| table.error(*line, error.to_string()))
        });
        let sections = sections.collect::<Result<Vec<_>>>()?;
        let n = names.len();
        let cut = |from: usize, to: usize| {
            table.rows.iter().flat_map(|row| row.1[from..to].iter().copied()).collect::<Vec<f64>>()
        };
        let part = |k: usize| cut(k * n + 1, (k + 1) * n + 1);
        let read = || {
            let mut out = Self::new(names, cut(0, 1), part(0), Some(part(1)), Vec::new())?;
            if kinds == 3 {
                out = out.with_accelerations(part(2))?;
            }
            if table.words.is_some() { out.with_sections(sections) } else { Ok(out) }
        };
        read().map_err(|error| table.error_in_file(error.to_string()))
    }

    /// Writes the fields of ROS `trajectory_msgs/JointTrajectory` (`joint_names`, `points` with `positions`,
    /// `velocities`, `accelerations` where there are any, `time_from_start` in `sec` and `nanosec`), and `events` and, where
    /// there are any, `section` (a word per row) beside them.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn to_json(&self, file: impl AsRef<FilePath>) -> Result<()> {
        let n = self.dof();
        let points = (0..self.rows()).map(|i| Point {
            positions: self.q_row(i).to_vec(),
            velocities: Some(self.qd_row(i).to_vec()),
            accelerations: self.qdd.as_ref().map(|qdd| qdd[i * n..(i + 1) * n].to_vec()),
            time_from_start: Duration::from_seconds(self.t[i]),
        });
        let events = self.events.iter().map(|event| EventRecord {
            kind: event.kind.as_str().into(),
            index: event.index,
            t: event.t,
            s: event.s,
            message: event.message.clone(),
        });
        let document = Document {
            joint_names: self.joint_names.clone(),
            points: points.collect(),
            events: events.collect(),
            section: self.sections.as_ref().map(|list| list.iter().map(Section::to_string).collect()),
        };
        let error = |message: String| Error::File { file: file.as_ref().display().to_string(), message };
        let text = serde_json::to_string(&document).map_err(|e| error(format!("cannot be written: {e}")))?;
        std::fs::write(file.as_ref(), text).map_err(|e| error(format!("cannot be written: {e}")))
    }

    /// Reads what [`to_json`](Self::to_json) writes, or a ROS `JointTrajectory` as JSON; times come back to the
    /// nanosecond. Velocities, accelerations, sections and events may be missing (an empty list is missing too, as in ROS);
    /// other fields are ignored.
    ///
    /// # Errors
    /// A file that cannot be read, is not JSON of this form, or whose numbers make no trajectory.
    pub fn from_json(file: impl AsRef<FilePath>) -> Result<Self> {
        let name = file.as_ref().display().to_string();
        let broken = |file: String, message: String| Error::File { file, message };
        let bytes = std::fs::read(file.as_ref())
            .map_err(|error| broken(name.clone(), format!("cannot be read: {error}")))?;
        let document: Document = serde_json::from_slice(&bytes)
            .map_err(|error| broken(format!("{name}:{}", error.line()), error.to_string()))?;
        document.trajectory().map_err(|error| broken(name, error.to_string()))
    }
}

/// Column names of a CSV file.
fn header(names: &[String], accelerations: bool, sections: bool) -> Vec<String> {
    let mut header = vec!["t".to_owned()];
    header.extend(names.iter().cloned());
    header.extend(names.iter().map(|name| format!("{name}{VELOCITY}")));
    if accelerations {
        header.extend(names.iter().map(|name| format!("{name}{ACCELERATION}")));
    }
    if sections {
        header.push(SECTION.into());
    }
    header
}

const VELOCITY: &str = "_velocity";
const ACCELERATION: &str = "_acceleration";
const SECTION: &str = "section";

#[derive(Serialize, Deserialize)]
struct Document {
    joint_names: Vec<String>,
    points: Vec<Point>,
    #[serde(default)]
    events: Vec<EventRecord>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    section: Option<Vec<String>>,
}

impl Document {
    fn trajectory(self) -> Result<Trajectory> {
        let n = self.joint_names.len();
        for (i, point) in self.points.iter().enumerate() {
            let given = |list: &'_ Option<Vec<f64>>| list.as_ref().map(Vec::len).filter(|len| *len > 0);
            let lengths =
                [Some(point.positions.len()), given(&point.velocities), given(&point.accelerations)];
            if let Some(length) = lengths.into_iter().flatten().find(|length| *length != n) {
                return Err(Error::Invalid(format!("point {i} has {length} numbers for {n} joints")));
            }
        }
        let t = self.points.iter().map(|point| point.time_from_start.seconds()).collect();
        let q = self.points.iter().flat_map(|point| point.positions.iter().copied()).collect();
        // All rows or none.
        let column = |of: fn(&Point) -> Option<&Vec<f64>>| {
            let lists: Option<Vec<&Vec<f64>>> =
                self.points.iter().map(|point| of(point).filter(|list| !list.is_empty())).collect();
            lists
                .filter(|lists| !lists.is_empty())
                .map(|lists| lists.into_iter().flatten().copied().collect())
        };
        let (qd, qdd) = (column(|p| p.velocities.as_ref()), column(|p| p.accelerations.as_ref()));
        let events = self.events.into_iter().map(|event| {
            let kind = event.kind.parse()?;
            Ok(Event { kind, index: event.index, t: event.t, s: event.s, message: event.message })
        });
        let mut out = Trajectory::new(self.joint_names, t, q, qd, events.collect::<Result<_>>()?)?;
        if let Some(qdd) = qdd {
            out = out.with_accelerations(qdd)?;
        }
        match self.section.filter(|words| !words.is_empty()) {
            None => Ok(out),
            Some(words) => out.with_sections(words.iter().map(|word| word.parse()).collect::<Result<_>>()?),
        }
    }
}

#[derive(Serialize, Deserialize)]
struct Point {
    positions: Vec<f64>,
    #[serde(default)]
    velocities: Option<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    accelerations: Option<Vec<f64>>,
    time_from_start: Duration,
}

#[derive(Serialize, Deserialize)]
struct EventRecord {
    kind: String,
    index: usize,
    t: f64,
    s: f64,
    message: String,
}

/// ROS `builtin_interfaces/Duration`: whole seconds and the nanoseconds after them.
#[derive(Serialize, Deserialize)]
struct Duration {
    sec: i64,
    nanosec: u32,
}

impl Duration {
    const NANO: f64 = 1e9;

    fn from_seconds(t: f64) -> Self {
        let nanosec = ((t - t.floor()) * Self::NANO).round();
        // 0.999 999 999 6 s is a whole second.
        let carry = nanosec >= Self::NANO;
        Self { sec: t.floor() as i64 + i64::from(carry), nanosec: if carry { 0 } else { nanosec as u32 } }
    }

    fn seconds(&self) -> f64 {
        self.sec as f64 + f64::from(self.nanosec) / Self::NANO
    }
}
