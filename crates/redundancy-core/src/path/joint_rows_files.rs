//! Joint rows from the files of other programs.

use std::path::Path as FilePath;

use serde_json::Value;

use super::joint_rows::JointRows;
use super::section::Section;
use super::table::Table;
use crate::error::{Error, Result};

/// Names of the column with the times.
const TIME: [&str; 4] = ["t", "time", "time_from_start", "time_s"];
/// What follows the name of a joint in the name of a column: of positions, velocities, accelerations, and what is not read.
const SUFFIXES: [&[&str]; 4] = [
    &["", "_position", "_pos", ".position"],
    &["_velocity", "_vel", ".velocity"],
    &["_acceleration", "_acc", ".acceleration"],
    &["_effort", "_torque", ".effort"],
];
const SECTION: &str = "section";
/// Objects in which a trajectory may be wrapped.
const WRAPPERS: [&str; 3] = ["trajectory", "joint_trajectory", "goal"];

impl JointRows {
    /// Reads a CSV file: a column of times (`t`, `time`, `time_from_start` or `time_s`, s), a column per joint (its name, or
    /// its name with `_position` or `_pos`), and, for all joints or none, columns with `_velocity` (`_vel`) and
    /// `_acceleration` (`_acc`), in any order. Times may be unsorted.
    ///
    /// # Errors
    /// A file that cannot be read, without times or joints, with fields that are no finite numbers: with name and line.
    pub fn from_csv(file: impl AsRef<FilePath>) -> Result<Self> {
        let table = Table::read_with_words(file.as_ref(), SECTION)?;
        let header = |message: String| table.error(table.header_line, message);
        let columns: Vec<String> =
            table.header.iter().map(|name| name.replace(char::is_whitespace, "")).collect();
        let time = TIME.iter().find_map(|name| columns.iter().position(|column| column == name));
        let Some(time) = time else {
            return Err(header(format!("has no column of times; expected one of: {}", TIME.join(", "))));
        };
        let kind = |column: &str| -> (usize, String) {
            for (kind, suffixes) in SUFFIXES.iter().enumerate() {
                for suffix in suffixes.iter().filter(|suffix| !suffix.is_empty()) {
                    if let Some(joint) = column.strip_suffix(suffix).filter(|joint| !joint.is_empty()) {
                        return (kind, joint.to_owned());
                    }
                }
            }
            (0, column.to_owned())
        };
        let mut names: Vec<String> = Vec::new();
        let mut found: Vec<[Option<usize>; 4]> = Vec::new();
        for (i, column) in columns.iter().enumerate().filter(|(i, _)| *i != time) {
            let (kind, joint) = kind(column);
            let at = names.iter().position(|name| *name == joint).unwrap_or_else(|| {
                names.push(joint);
                found.push([None; 4]);
                names.len() - 1
            });
            if found[at][kind].replace(i).is_some() {
                return Err(header(format!("column '{column}' occurs twice")));
            }
        }
        let collect = |kind: usize, needed: bool| -> Result<Option<Vec<f64>>> {
            let missing = found.iter().position(|columns| columns[kind].is_none());
            let any = found.iter().any(|columns| columns[kind].is_some());
            match missing {
                Some(joint) if any || needed => {
                    let what = ["position", "velocity", "acceleration", "effort"][kind];
                    return Err(header(format!("has no column with the {what} of joint '{}'", names[joint])));
                }
                Some(_) => return Ok(None),
                None => {}
            }
            let order: Vec<usize> = found.iter().filter_map(|columns| columns[kind]).collect();
            Ok(Some(table.rows.iter().flat_map(|(_, row)| order.iter().map(|i| row[*i])).collect()))
        };
        let q = collect(0, true)?.unwrap_or_default();
        let (qd, qdd) = (collect(1, false)?, collect(2, false)?);
        let t = table.rows.iter().map(|(_, row)| row[time]).collect();
        let sections = table.words.as_ref().map(|words| {
            let lines = words.iter().zip(&table.rows);
            lines
                .map(|(word, (line, _))| {
                    word.parse::<Section>().map_err(|e| table.error(*line, e.to_string()))
                })
                .collect::<Result<Vec<Section>>>()
        });
        let rows = Self::new(names, t, q, qd, qdd, sections.transpose()?);
        rows.map_err(|error| table.error_in_file(error.to_string()))
    }

    /// Reads a JSON file: a ROS `JointTrajectory` (`joint_names`, `points` with `positions`, `velocities`, `accelerations`,
    /// `time_from_start` as `sec` and `nanosec`, as `secs` and `nsecs` or as a number), also inside of an object `trajectory`,
    /// `joint_trajectory` or `goal`, or an object with `joint_names`, `t`, `q` and, where wanted, `qd` and `qdd`. Times may be
    /// unsorted.
    ///
    /// # Errors
    /// A file that cannot be read, is not JSON of this form, or holds no rows of finite numbers.
    pub fn from_json(file: impl AsRef<FilePath>) -> Result<Self> {
        let name = file.as_ref().display().to_string();
        let broken = |file: String, message: String| Error::File { file, message };
        let bytes = std::fs::read(file.as_ref())
            .map_err(|error| broken(name.clone(), format!("cannot be read: {error}")))?;
        if bytes.iter().all(u8::is_ascii_whitespace) {
            return Err(broken(name, "is empty, expected a JointTrajectory".into()));
        }
        let document: Value = serde_json::from_slice(&bytes)
            .map_err(|error| broken(format!("{name}:{}", error.line()), error.to_string()))?;
        of_document(&document).map_err(|error| broken(name, error.to_string()))
    }
}

fn invalid<T>(message: String) -> Result<T> {
    Err(Error::Invalid(message))
}

fn of_document(document: &Value) -> Result<JointRows> {
    let mut document = match document {
        Value::Array(list) if list.len() == 1 => &list[0],
        other => other,
    };
    while let Some(inner) = WRAPPERS.iter().find_map(|name| document.get(name)) {
        document = match inner {
            Value::Array(list) if list.len() == 1 => &list[0],
            other => other,
        };
    }
    let Some(names) = document.get("joint_names").and_then(Value::as_array) else {
        return invalid("has no 'joint_names': expected the fields of a JointTrajectory".into());
    };
    let names = names.iter().map(|name| match name.as_str() {
        Some(name) => Ok(name.to_owned()),
        None => invalid(format!("joint name {name} is not a string")),
    });
    let names = names.collect::<Result<Vec<String>>>()?;
    let sections = match document.get(SECTION).and_then(Value::as_array).filter(|words| !words.is_empty()) {
        None => None,
        Some(words) => {
            let parse = |word: &Value| word.as_str().unwrap_or_default().parse::<Section>();
            Some(words.iter().map(parse).collect::<Result<Vec<_>>>()?)
        }
    };
    if let Some(points) = document.get("points").and_then(Value::as_array) {
        return of_points(names, points, sections);
    }
    let column = |name: &str| document.get(name).filter(|value| !value.is_null());
    let (Some(t), Some(q)) = (column("t"), column("q")) else {
        return invalid("has neither 'points' nor 't' and 'q'".into());
    };
    let n = names.len();
    let rows = |name: &str, value: &Value| -> Result<Vec<f64>> {
        let Some(list) = value.as_array() else { return invalid(format!("'{name}' is not a list of rows")) };
        let mut out = Vec::with_capacity(list.len() * n);
        for (i, row) in list.iter().enumerate() {
            out.extend(numbers(&format!("{name}[{i}]"), row, n)?);
        }
        Ok(out)
    };
    let qd = column("qd").map(|value| rows("qd", value)).transpose()?;
    let qdd = column("qdd").map(|value| rows("qdd", value)).transpose()?;
    let q = rows("q", q)?;
    JointRows::new(names, numbers("t", t, q.len() / n.max(1))?, q, qd, qdd, sections)
}

fn of_points(names: Vec<String>, points: &[Value], sections: Option<Vec<Section>>) -> Result<JointRows> {
    let n = names.len();
    let (mut t, mut q) = (Vec::with_capacity(points.len()), Vec::with_capacity(points.len() * n));
    let mut rates = [Some(Vec::new()), Some(Vec::new())];
    for (i, point) in points.iter().enumerate() {
        let Some(positions) = point.get("positions") else {
            return invalid(format!("point {i} has no 'positions'"));
        };
        q.extend(numbers(&format!("positions of point {i}"), positions, n)?);
        for (rate, name) in rates.iter_mut().zip(["velocities", "accelerations"]) {
            let given = point.get(name).filter(|value| value.as_array().is_some_and(|list| !list.is_empty()));
            // All points or none.
            match (given, rate.as_mut()) {
                (Some(value), Some(all)) => all.extend(numbers(&format!("{name} of point {i}"), value, n)?),
                _ => *rate = None,
            }
        }
        match point.get("time_from_start").and_then(seconds) {
            Some(time) => t.push(time),
            None => {
                return invalid(format!(
                    "point {i} has no 'time_from_start' in sec and nanosec or in seconds"
                ));
            }
        }
    }
    let [qd, qdd] = rates;
    JointRows::new(names, t, q, qd, qdd, sections)
}

/// A list of `count` numbers.
fn numbers(what: &str, value: &Value, count: usize) -> Result<Vec<f64>> {
    let Some(list) = value.as_array() else { return invalid(format!("{what}: not a list of numbers")) };
    if list.len() != count {
        return Err(Error::Length { what: what.into(), expected: count, actual: list.len() });
    }
    let read = |(i, value): (usize, &Value)| match value.as_f64() {
        Some(number) => Ok(number),
        None => invalid(format!("{what}: entry {i} is {value}, expected a number")),
    };
    list.iter().enumerate().map(read).collect()
}

/// A duration of ROS 1 or ROS 2, or a number.
fn seconds(value: &Value) -> Option<f64> {
    if let Some(number) = value.as_f64() {
        return Some(number);
    }
    let part = |names: [&str; 2]| names.iter().find_map(|name| value.get(name)).and_then(Value::as_f64);
    let (whole, nano) = (part(["sec", "secs"]), part(["nanosec", "nsecs"]));
    (whole.is_some() || nano.is_some()).then(|| whole.unwrap_or(0.0) + nano.unwrap_or(0.0) * 1e-9)
}
