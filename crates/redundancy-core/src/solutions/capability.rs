//! What an arm can do at many poses: whether it reaches them, with how much margin, and how much freedom is left.
//!
//! Each pose is answered from its [`Solutions`], spread over the current pool, with the same bits whatever the number of threads. Without
//! a [`ToolFreedom`] the answers of closed forms are exact. With one the margin is the best that a grid of spins and tilts with a
//! pattern search around its best point finds.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{Rotation3, Unit, Vector3};

use super::closed_form::{ClosedForm, closed_form};
use super::over_pose::{SolutionsSettings, solutions};
use super::solutions::{Solution, Solutions};
use crate::chain::Chain;
use crate::criterion::Manipulability;
use crate::error::{Error, Result, check_length};
use crate::joint_space::TURN;
use crate::kinematics::{Scratch, SpinFreedom, Task, ToolFreedom};
use crate::parallel::prelude::*;
use crate::pose::{Pose, pose_from_row_major};
use crate::scene::{Proximity, ProximityMemory, Surroundings};
use crate::solutions::at;
use crate::status::Status;
use crate::tolerance::{LIMIT_SLACK, SLOPE_ROUNDING};

/// Poses that one task of the pool takes at least.
const TASK: usize = 16;
/// Spins over a whole turn that are looked at first.
const SPINS: usize = 36;
/// Directions of tilt on the outer ring of a cone; half as many are on the inner one.
const TILTS: usize = 12;
/// Halvings in which the end of a range of spins is found.
const END_HALVINGS: usize = 30;

/// One thing to know about a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Whether a configuration within the joint limits exists.
    Reachable,
    /// The largest margin from the joint limits.
    Margin,
    /// Whether that margin is proven to be the largest.
    Proven,
    /// How much of the self-motion holds the limits.
    SwivelMeasure,
    /// `det(J J^T)` at the largest margin.
    Manipulability,
    /// The share of the spin that is feasible.
    SpinShare,
    /// The least distance from obstacles and between links at the largest margin.
    Clearance,
}

impl Metric {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Reachable,
        Self::Margin,
        Self::Proven,
        Self::SwivelMeasure,
        Self::Manipulability,
        Self::SpinShare,
        Self::Clearance,
    ];

    /// Its name in lower snake case.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Reachable => "reachable",
            Self::Margin => "margin",
            Self::Proven => "proven",
            Self::SwivelMeasure => "swivel_measure",
            Self::Manipulability => "manipulability",
            Self::SpinShare => "spin_share",
            Self::Clearance => "clearance",
        }
    }

    /// By its name.
    ///
    /// # Errors
    /// A name that is none of them.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|metric| metric.as_str() == name).ok_or_else(|| Error::UnknownName {
            kind: "metric",
            name: name.into(),
            valid: Self::ALL.iter().map(|metric| metric.as_str().into()).collect(),
        })
    }
}

/// What is known of one pose. What was not asked for is at its worst value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// Whether a configuration within the joint limits exists.
    pub reachable: bool,
    /// The least distance of a joint from a limit (rad or m) in the configuration in which that is largest; negative by how much the
    /// worst joint misses its limits at best, `-inf` where no configuration exists.
    pub margin: f64,
    /// Whether that is proven.
    pub proven: bool,
    /// See [`Solutions::feasible_measure`].
    pub swivel_measure: f64,
    /// `det(J J^T)` of the pose task at the configuration of the margin; 0 where there is none.
    pub manipulability: f64,
    /// The share of the allowed spins, without tilt, at which a configuration within the limits exists.
    pub spin_share: f64,
    /// The least distance from obstacles and between links (m) at the configuration of the margin; `-inf` where there is
    /// none, `inf` where nothing is near.
    pub clearance: f64,
}

impl Measures {
    const NONE: Self = Self {
        reachable: false,
        margin: f64::NEG_INFINITY,
        proven: false,
        swivel_measure: 0.0,
        manipulability: 0.0,
        spin_share: 0.0,
        clearance: f64::NEG_INFINITY,
    };

    /// A metric as a number: 1 and 0 for yes and no.
    pub fn value(&self, metric: Metric) -> f64 {
        match metric {
            Metric::Reachable => f64::from(u8::from(self.reachable)),
            Metric::Margin => self.margin,
            Metric::Proven => f64::from(u8::from(self.proven)),
            Metric::SwivelMeasure => self.swivel_measure,
            Metric::Manipulability => self.manipulability,
            Metric::SpinShare => self.spin_share,
            Metric::Clearance => self.clearance,
        }
    }
}

/// What to know, and how far the tool may leave the poses.
#[derive(Debug, Clone, Default)]
pub struct CapabilitySettings {
    /// How far the tool may tilt and spin away from each pose.
    pub freedom: ToolFreedom,
    /// What the arm must not touch, for the clearance.
    pub around: Option<Surroundings>,
    /// What is asked for.
    pub metrics: Vec<Metric>,
}

/// Answers what an arm can do at poses.
///
/// ```
/// use redundancy_core::{chain::catalog, pose_to_row_major};
/// use redundancy_core::solutions::{Capability, CapabilitySettings, Metric};
/// let chain = catalog::load("panda")?;
/// let pose = chain.forward(&[0.3, 0.5, -0.2, -1.1, 0.4, 1.7, -0.9])?;
/// let metrics = vec![Metric::Reachable, Metric::Margin];
/// let arm = Capability::new(&chain, None, CapabilitySettings { metrics, ..Default::default() })?;
/// let found = arm.measure_batch(&pose_to_row_major(&pose))?[0];
/// assert!(found.reachable && found.margin > 0.5);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug)]
pub struct Capability {
    chain: Chain,
    form: Option<Arc<dyn ClosedForm>>,
    settings: CapabilitySettings,
    manipulability: Manipulability,
}

/// Memory of one thread.
struct Memory {
    scratch: Scratch,
    proximity: ProximityMemory,
    q: Vec<f64>,
}

impl Capability {
    /// For an arm, with its closed form where that is known.
    ///
    /// # Errors
    /// The clearance without anything to keep it from.
    pub fn new(
        chain: &Chain,
        form: Option<Arc<dyn ClosedForm>>,
        settings: CapabilitySettings,
    ) -> Result<Self> {
        if settings.metrics.contains(&Metric::Clearance) && settings.around.is_none() {
            return Err(Error::Invalid(
                "the metric 'clearance' needs a scene, or links with pairs that must not touch".into(),
            ));
        }
        let form = form.or_else(|| closed_form(chain));
        let manipulability = Manipulability::new(chain, Task::POSE);
        Ok(Self { chain: chain.clone(), form, settings, manipulability })
    }

    /// Whether poses are answered by a closed form.
    pub fn has_closed_form(&self) -> bool {
        self.form.is_some()
    }

    /// What is asked for at many poses (`N * 16` numbers, row-major matrices).
    ///
    /// # Errors
    /// A wrong length, a pose that is not rigid or finite (the message gives its index), an arm whose solutions over a pose have
    /// more than one dimension.
    pub fn measure_batch(&self, poses: &[f64]) -> Result<Vec<Measures>> {
        check_length("poses", poses, poses.len() / 16 * 16)?;
        let memory = || Memory {
            scratch: Scratch::new(&self.chain),
            proximity: ProximityMemory::new(),
            q: vec![0.0; self.chain.dof()],
        };
        let one = |memory: &mut Memory, (i, pose): (usize, &[f64; 16])| {
            let pose = pose_from_row_major(pose).map_err(at(i))?;
            self.measure(&pose, memory).map_err(at(i))
        };
        poses.as_chunks::<16>().0.par_iter().enumerate().with_min_len(TASK).map_init(memory, one).collect()
    }

    fn asks(&self, metric: Metric) -> bool {
        self.settings.metrics.contains(&metric)
    }

    fn solutions(&self, pose: &Pose) -> Result<Box<dyn Solutions>> {
        match &self.form {
            Some(form) => form.solutions(pose),
            None => {
                solutions(&self.chain, pose, &SolutionsSettings { closed_form: false, ..Default::default() })
            }
        }
    }

    /// Whether a configuration within the limits exists.
    fn reaches(&self, pose: &Pose, q: &mut [f64]) -> Result<bool> {
        if let Some(form) = &self.form {
            match form.select(pose, None, None, q) {
                Status::Converged => return Ok(true),
                Status::Limits | Status::Unreachable => return Ok(false),
                _ => {}
            }
        }
        Ok(self.solutions(pose)?.status() == Status::Converged)
    }

    fn measure(&self, pose: &Pose, memory: &mut Memory) -> Result<Measures> {
        let mut out = Measures::NONE;
        let needs_margin = [Metric::Margin, Metric::Proven, Metric::Manipulability, Metric::Clearance];
        let free = !self.settings.freedom.is_none();
        let wants_margin = needs_margin.into_iter().any(|metric| self.asks(metric));
        let set = if self.asks(Metric::SwivelMeasure) || wants_margin && !free {
            Some(self.solutions(pose)?)
        } else {
            None
        };
        if let Some(set) = set.as_ref().filter(|_| self.asks(Metric::SwivelMeasure)) {
            out.swivel_measure = set.feasible_measure()?;
        }
        if self.asks(Metric::SpinShare) {
            out.spin_share = self.spin_share(pose, memory)?;
        }
        if !wants_margin {
            if self.asks(Metric::Reachable) {
                out.reachable = self.reaches(pose, &mut memory.q)?
                    || free && self.best_of_freedom(pose)?.is_some_and(|best| best.value >= -LIMIT_SLACK);
            }
            return Ok(out);
        }
        let best = match &set {
            Some(set) if !free => {
                let best = set.best_margin()?;
                if self.asks(Metric::Proven) {
                    out.proven = match &best {
                        Some(best) => best.proven || set.proves_margin(best.value),
                        None => set.proven(),
                    };
                }
                best
            }
            _ => self.best_of_freedom(pose)?,
        };
        if let Some(best) = best {
            out.reachable = best.value >= -LIMIT_SLACK;
            out.margin = best.value;
            self.at_configuration(&best.q, memory, &mut out)?;
        }
        Ok(out)
    }

    /// What depends on the configuration.
    fn at_configuration(&self, q: &[f64], memory: &mut Memory, out: &mut Measures) -> Result<()> {
        if !self.asks(Metric::Manipulability) && !self.asks(Metric::Clearance) {
            return Ok(());
        }
        let kinematics = self.chain.kinematics(q, &mut memory.scratch)?;
        if self.asks(Metric::Manipulability) {
            out.manipulability = self.manipulability.value_at(&kinematics);
        }
        if let Some(around) = self.settings.around.as_ref().filter(|_| self.asks(Metric::Clearance)) {
            let near = around.nearest(&kinematics, 0.0, f64::INFINITY, &mut memory.proximity);
            out.clearance = near.map_or(f64::INFINITY, |near| near.gap.distance);
        }
        Ok(())
    }

    /// The spin that is allowed to either side, rad.
    fn spin_to_either_side(&self) -> f64 {
        match self.settings.freedom.spin() {
            SpinFreedom::Free => PI,
            SpinFreedom::Within(angle) => angle.min(PI),
        }
    }

    /// `pose` with the tool axis leant by the rotation vector `(x, y)` across it, and turned by `spin` about it.
    fn turned(&self, pose: &Pose, [spin, x, y]: [f64; 3]) -> Pose {
        let axis: Unit<Vector3<f64>> = self.settings.freedom.axis();
        let mut turned = *pose;
        if x != 0.0 || y != 0.0 {
            let across = across(&axis);
            turned.rotation *= Rotation3::new(across[0] * x + across[1] * y);
        }
        turned.rotation *= Rotation3::from_axis_angle(&axis, spin);
        turned
    }

    /// The largest margin that is found within the freedom of the tool.
    fn best_of_freedom(&self, pose: &Pose) -> Result<Option<Solution>> {
        let (limit, cone) = (self.spin_to_either_side(), self.settings.freedom.half_angle());
        let spins = (limit / PI * SPINS as f64 / 2.0).ceil();
        let step = if spins > 0.0 { limit / spins } else { 0.0 };
        let mut found = FreedomSearch { capability: self, pose, best: None };
        for [x, y] in tilts(cone) {
            for k in -(spins as i32)..=spins as i32 {
                found.offer([step * f64::from(k), x, y])?;
            }
        }
        // A pattern search around the best point, within the freedom.
        let mut steps = [step, 0.5 * cone, 0.5 * cone];
        while steps.iter().any(|step| *step > SLOPE_ROUNDING) {
            let mut moved = false;
            for i in (0..3).filter(|i| steps[*i] > 0.0) {
                for sign in [1.0, -1.0] {
                    let Some((_, mut next)) = found.best.as_ref().map(|(best, at)| (best, *at)) else {
                        return Ok(None);
                    };
                    next[i] += sign * steps[i];
                    let allowed = (limit >= PI || next[0].abs() <= limit) && next[1].hypot(next[2]) <= cone;
                    moved |= allowed && found.offer(next)?;
                }
            }
            if !moved {
                steps = steps.map(|step| 0.5 * step);
            }
        }
        Ok(found.best.map(|(best, _)| best))
    }

    /// The share of the allowed spins, without tilt, at which a configuration within the limits exists: from samples ten degrees
    /// apart, between which every change is found.
    fn spin_share(&self, pose: &Pose, memory: &mut Memory) -> Result<f64> {
        let limit = self.spin_to_either_side();
        let q = &mut memory.q;
        if limit == 0.0 {
            return Ok(f64::from(u8::from(self.reaches(pose, q)?)));
        }
        let mut reaches = |spin: f64| self.reaches(&self.turned(pose, [spin, 0.0, 0.0]), q);
        let parts = ((limit / PI * SPINS as f64).ceil() as usize).max(2);
        let at = |k: usize| -limit + 2.0 * limit * k as f64 / parts as f64;
        let mut share = 0.0;
        let mut last = reaches(at(0))?;
        for k in 1..=parts {
            let next = reaches(at(k))?;
            let (mut a, mut b) = (at(k - 1), at(k));
            let width = b - a;
            if last != next {
                for _ in 0..END_HALVINGS {
                    let middle = 0.5 * (a + b);
                    if reaches(middle)? == last { a = middle } else { b = middle }
                }
                share += if last { a - at(k - 1) } else { at(k) - b };
            } else if last {
                share += width;
            }
            last = next;
        }
        Ok((share / (2.0 * limit)).clamp(0.0, 1.0))
    }
}

/// The best pose within a freedom so far: its solution, and spin and tilt.
struct FreedomSearch<'a> {
    capability: &'a Capability,
    pose: &'a Pose,
    best: Option<(Solution, [f64; 3])>,
}

impl FreedomSearch<'_> {
    /// Takes a pose when it is better; whether it is.
    fn offer(&mut self, freedom: [f64; 3]) -> Result<bool> {
        let turned = self.capability.turned(self.pose, freedom);
        let Some(found) = self.capability.solutions(&turned)?.best_margin()? else { return Ok(false) };
        let better = self.best.as_ref().is_none_or(|(best, _)| found.value > best.value);
        if better {
            self.best = Some((Solution { proven: false, ..found }, freedom));
        }
        Ok(better)
    }
}

/// Tilts within a cone that are looked at first.
fn tilts(cone: f64) -> Vec<[f64; 2]> {
    let mut tilts = vec![[0.0; 2]];
    if cone > 0.0 {
        for (radius, count) in [(0.5 * cone, TILTS / 2), (cone, TILTS)] {
            tilts.extend((0..count).map(|k| {
                let (sin, cos) = (TURN * k as f64 / count as f64).sin_cos();
                [radius * cos, radius * sin]
            }));
        }
    }
    tilts
}

/// Two unit vectors across an axis.
fn across(axis: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let helper = if axis.x.abs() < axis.y.abs() { Vector3::x() } else { Vector3::y() };
    let first = axis.cross(&helper).normalize();
    [first, axis.cross(&first)]
}
