//! Paths and trajectories as CSV and JSON files.

use std::path::Path as FilePath;

use nalgebra::{Quaternion, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::path::{Path, arc_length_grows, whole};
use super::piece::Shape;
use super::section::Section;
use super::table::{self, Table};
use super::trajectory::{Event, Trajectory};
use crate::error::{Error, Result};
use crate::pose::Pose;
use crate::tolerance::QUATERNION_NORM;

const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
const COLUMNS: [&str; 9] = ["x", "y", "z", "qw", "qx", "qy", "qz", "t", "s"];

impl Path {
    /// Reads a CSV file with the columns `x,y,z` (metres), `qw,qx,qy,qz` (all four or none) and, where wanted, `s`
    /// (metres) and `t` (seconds), in any order under a header line.
    ///
    /// Quaternions whose norm is within [`QUATERNION_NORM`] of 1 are normalised.
    ///
    /// # Errors
    /// A file that cannot be read, a column that is missing, unknown or double, a field that is no finite number, a
    /// quaternion that is not of unit norm, `s` or `t` that do not increase: with the file's name and line.
    pub fn from_csv(file: impl AsRef<FilePath>) -> Result<Self> {
        let table = Table::read(file.as_ref())?;
        if let Some(unknown) = table.header.iter().find(|name| !COLUMNS.contains(&name.as_str())) {
            let message = format!("unknown column '{unknown}', expected {}", COLUMNS.join(","));
            return Err(table.error(table.header_line, message));
        }
        let column = |name: &str| {
            table.column(name).ok_or_else(|| {
                let known = table.header.join(",");
                table.error(table.header_line, format!("column '{name}' is missing in the header '{known}'"))
            })
        };
        let xyz = [column("x")?, column("y")?, column("z")?];
        let oriented = QUATERNION.iter().any(|name| table.column(name).is_some());
        let wxyz =
            if oriented { Some([column("qw")?, column("qx")?, column("qy")?, column("qz")?]) } else { None };
        let mut poses = Vec::with_capacity(table.rows.len());
        for (line, row) in &table.rows {
            let mut pose = Pose::translation(row[xyz[0]], row[xyz[1]], row[xyz[2]]);
            if let Some([w, x, y, z]) = wxyz.map(|columns| columns.map(|column| row[column])) {
                let q = Quaternion::new(w, x, y, z);
                let norm = q.norm();
                if (norm - 1.0).abs() > QUATERNION_NORM {
                    let message = format!(
                        "quaternion (qw, qx, qy, qz) has norm {norm}, it must be within {QUATERNION_NORM} of 1"
                    );
                    return Err(table.error(*line, message));
                }
                pose.rotation = UnitQuaternion::from_quaternion(q).to_rotation_matrix();
            }
            poses.push(pose);
        }
        let numbers = |name: &str| {
            table.column(name).map(|c| table.rows.iter().map(|row| row.1[c]).collect::<Vec<f64>>())
        };
        let (s, t) = (numbers("s"), numbers("t"));
        if let Some(t) = &t
            && let Some(i) = (1..t.len()).find(|i| t[*i] <= t[*i - 1])
        {
            let message = format!("t is {} after {}, it must increase", t[i], t[i - 1]);
            return Err(table.error(table.rows[i].0, message));
        }
        if let Some(s) = &s
            && let Some(i) = (1..s.len()).find(|i| !arc_length_grows(&poses, s, *i))
        {
            let message = format!("s is {} after {}, it must increase with the pose", s[i], s[i - 1]);
            return Err(table.error(table.rows[i].0, message));
        }
        let pieces = whole(Shape::Spline, poses.len());
        let path = Self::build(pieces, poses, oriented, s.as_deref(), t.as_deref());
        path.map_err(|error| table.error_in_file(error.to_string()))
    }

    /// Writes the samples as [`from_csv`](Self::from_csv) reads them.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn to_csv(&self, file: impl AsRef<FilePath>) -> Result<()> {
        let mut header: Vec<String> = vec!["s".into(), "x".into(), "y".into(), "z".into()];
        if self.has_orientation() {
            header.extend(QUATERNION.map(String::from));
        }
        if self.t().is_some() {
            header.push("t".into());
        }
        let rows = (0..self.len()).map(|i| {
            let p = self.poses()[i].translation.vector;
            let mut row = vec![self.s()[i], p.x, p.y, p.z];
            if self.has_orientation() {
                let q = UnitQuaternion::from_rotation_matrix(&self.poses()[i].rotation);
                row.extend([q.w, q.i, q.j, q.k]);
            }
            row.extend(self.t().map(|t| t[i]));
            row
        });
        table::write(file.as_ref(), &header, rows)
    }
}

impl Trajectory {
    /// Writes `t,<joint>...,<joint>_velocity...`, one line per instant; `<joint>_acceleration...` and `section` follow where
    /// the trajectory has them. Events are not part of it.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn to_csv(&self, file: impl AsRef<FilePath>) -> Result<()> {
        let header = header(self.joint_names(), self.qdd().is_some(), self.sections().is_some());
        let n = self.dof();
        let rows = (0..self.rows()).map(|i| {
            let mut row = vec![self.t()[i]];
            row.extend(self.q_row(i));
            row.extend(self.qd_row(i));
            row.extend(self.qdd().into_iter().flat_map(|qdd| &qdd[i * n..(i + 1) * n]));
            let word = self.sections().into_iter().map(|sections| sections[i].to_string());
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
            accelerations: self.qdd().map(|qdd| qdd[i * n..(i + 1) * n].to_vec()),
            time_from_start: Duration::from_seconds(self.t()[i]),
        });
        let events = self.events().iter().map(|event| EventRecord {
            kind: event.kind.as_str().into(),
            index: event.index,
            t: event.t,
            s: event.s,
            message: event.message.clone(),
        });
        let document = Document {
            joint_names: self.joint_names().to_vec(),
            points: points.collect(),
            events: events.collect(),
            section: self.sections().map(|list| list.iter().map(Section::to_string).collect()),
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
