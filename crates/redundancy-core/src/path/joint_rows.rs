//! Joint rows of any origin, before they are a trajectory: joints in any order, times that may not increase.

use super::section::Section;
use super::trajectory::Trajectory;
use crate::chain::Chain;
use crate::error::{Error, Result, check_finite, check_length};

/// Rows of joint positions over time as a file has them.
///
/// ```
/// use redundancy_core::{chain::catalog, path::JointRows};
/// let arm = catalog::load("planar3r")?;
/// let names: Vec<String> = arm.joints().iter().rev().map(|joint| joint.name.clone()).collect();
/// let rows = JointRows::new(names, vec![0.0, 1.0], vec![3.0, 2.0, 1.0, 3.0, 2.0, 1.0], None, None, None)?;
/// assert_eq!(rows.in_order_of(&arm)?.q, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointRows {
    /// The joints, in the order of the columns.
    pub joint_names: Vec<String>,
    /// Times, s.
    pub t: Vec<f64>,
    /// Positions row by row, rad or m.
    pub q: Vec<f64>,
    /// Velocities row by row.
    pub qd: Option<Vec<f64>>,
    /// Accelerations row by row.
    pub qdd: Option<Vec<f64>>,
    /// To which part of the motion each row belongs.
    pub sections: Option<Vec<Section>>,
}

impl JointRows {
    /// Rows of finite numbers, one entry per joint.
    ///
    /// # Errors
    /// No joint, a joint named twice, lengths that do not match, numbers that are not finite.
    pub fn new(
        joint_names: Vec<String>,
        t: Vec<f64>,
        q: Vec<f64>,
        qd: Option<Vec<f64>>,
        qdd: Option<Vec<f64>>,
        sections: Option<Vec<Section>>,
    ) -> Result<Self> {
        if joint_names.is_empty() {
            return Err(Error::Length { what: "joint names".into(), expected: 1, actual: 0 });
        }
        if let Some(i) = (1..joint_names.len()).find(|i| joint_names[..*i].contains(&joint_names[*i])) {
            return Err(Error::Invalid(format!("joint name '{}' is used twice", joint_names[i])));
        }
        let entries = t.len() * joint_names.len();
        check_finite("t", &t)?;
        let columns = [("positions", Some(&q)), ("velocities", qd.as_ref()), ("accelerations", qdd.as_ref())];
        for (what, values) in columns.into_iter().filter_map(|(what, values)| Some((what, values?))) {
            check_length(what, values, entries)?;
            check_finite(what, values)?;
        }
        if let Some(sections) = sections.as_ref().filter(|sections| sections.len() != t.len()) {
            let (expected, actual) = (t.len(), sections.len());
            return Err(Error::Length { what: "section".into(), expected, actual });
        }
        Ok(Self { joint_names, t, q, qd, qdd, sections })
    }

    /// The same rows with the joints in the order of the chain.
    ///
    /// # Errors
    /// Joints that are missing, and joints that are not in the chain.
    pub fn in_order_of(&self, chain: &Chain) -> Result<Self> {
        let wanted: Vec<&str> = chain.joints().iter().map(|joint| joint.name.as_str()).collect();
        let found = |name: &str| self.joint_names.iter().position(|own| own == name);
        let columns: Option<Vec<usize>> = wanted.iter().map(|name| found(name)).collect();
        let extra: Vec<&str> =
            self.joint_names.iter().map(String::as_str).filter(|name| !wanted.contains(name)).collect();
        let (Some(columns), true) = (columns, extra.is_empty()) else {
            let missing: Vec<&str> = wanted.iter().copied().filter(|name| found(name).is_none()).collect();
            let list = |what: &str, names: &[&str]| {
                if names.is_empty() { String::new() } else { format!("; {what}: {}", names.join(", ")) }
            };
            return Err(Error::Invalid(format!(
                "the trajectory does not move the joints of '{}'{}{}; its joints are {}",
                chain.name(),
                list("missing", &missing),
                list("not in the chain", &extra),
                wanted.join(", ")
            )));
        };
        let sort = |values: &Vec<f64>| -> Vec<f64> {
            let rows = values.chunks_exact(self.joint_names.len());
            rows.flat_map(|row| columns.iter().map(|column| row[*column])).collect()
        };
        Ok(Self {
            joint_names: wanted.into_iter().map(str::to_owned).collect(),
            t: self.t.clone(),
            q: sort(&self.q),
            qd: self.qd.as_ref().map(sort),
            qdd: self.qdd.as_ref().map(sort),
            sections: self.sections.clone(),
        })
    }

    /// As a trajectory; without velocities they are differences of the positions, see [`Trajectory::new`].
    ///
    /// # Errors
    /// Times that do not increase.
    pub fn trajectory(self) -> Result<Trajectory> {
        let mut out = Trajectory::new(self.joint_names, self.t, self.q, self.qd, Vec::new())?;
        if let Some(qdd) = self.qdd {
            out = out.with_accelerations(qdd)?;
        }
        match self.sections {
            Some(sections) => out.with_sections(sections),
            None => Ok(out),
        }
    }
}

impl From<Trajectory> for JointRows {
    fn from(given: Trajectory) -> Self {
        Self {
            joint_names: given.joint_names().to_vec(),
            t: given.t().to_vec(),
            q: given.q().to_vec(),
            qd: Some(given.qd().to_vec()),
            qdd: given.qdd().map(<[f64]>::to_vec),
            sections: given.sections().map(<[Section]>::to_vec),
        }
    }
}
