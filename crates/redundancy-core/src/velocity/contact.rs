//! Hard distances in a velocity step: how fast each near pair may come nearer.
//!
//! For a pair at distance d with gradient g the joint velocity keeps
//!
//! ```text
//! g . qd >= -min(alpha (d - d_safe), sqrt(2 a_d (d - d_safe))) - dd/dt
//! ```
//!
//! with alpha the barrier rate, at most `1 / dt`, `a_d = sum |g_i| a_i` the deceleration along g that the joints' acceleration limits
//! allow together, and dd/dt the motion of the obstacle itself. Below d_safe the first term alone counts: it leads away.
//! Pairs that cannot get there within the joints' speed limits are left out; of more than [`MOST_PAIRS`] the nearest stay.

use crate::chain::Chain;
use crate::error::{Error, Result, check_finite};
use crate::kinematics::Kinematics;
use crate::scene::{Contact, Proximity, ProximityMemory, Surroundings, Thing, Visitor};
use crate::tolerance::{BOX_VIOLATION, CONTACT_HORIZON, CONTACT_SLOPE};

/// Most pairs that are checked in one step.
pub(super) const MOST_PAIRS: usize = 64;

/// How a velocity step keeps its distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactSettings {
    /// Distance that is kept, m.
    pub safe_distance: f64,
    /// How fast the distance to it may shrink, 1/s.
    pub barrier_rate: f64,
}

impl Default for ContactSettings {
    fn default() -> Self {
        Self { safe_distance: 0.02, barrier_rate: 5.0 }
    }
}

impl ContactSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// A distance that is negative, a rate that is not positive, numbers that are not finite.
    pub fn validate(&self) -> Result<()> {
        check_finite("safe_distance, barrier_rate", &[self.safe_distance, self.barrier_rate])?;
        for (what, value, fits, bound) in [
            ("safe_distance", self.safe_distance, self.safe_distance >= 0.0, ">= 0 m"),
            ("barrier_rate", self.barrier_rate, self.barrier_rate > 0.0, "> 0 per s"),
        ] {
            if !fits {
                return Err(Error::OutOfRange { what: what.into(), value, bound: bound.into() });
            }
        }
        Ok(())
    }
}

/// A pair that held a step back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitingPair {
    /// The one that moves with the arm.
    pub first: Thing,
    /// The other one.
    pub second: Thing,
    /// Their distance before the step, m.
    pub distance: f64,
}

/// The pairs that a step has to mind, nearest first.
#[derive(Debug)]
pub(super) struct Contacts {
    pub around: Surroundings,
    pub settings: ContactSettings,
    /// Time of the next step, for obstacles that move, s.
    pub t: f64,
    pub pairs: Vec<LimitingPair>,
    /// n numbers for each pair.
    pub gradients: Vec<f64>,
    /// Least change of the distance of each pair, m/s.
    pub low: Vec<f64>,
    by_time: Vec<f64>,
    one: Vec<f64>,
    memory: ProximityMemory,
    /// Pairs that held the last step back.
    pub limiting: Vec<LimitingPair>,
}

impl Clone for Contacts {
    fn clone(&self) -> Self {
        Self {
            limiting: self.limiting.clone(),
            ..Self::new(self.around.clone(), self.settings, self.one.len(), self.t)
        }
    }
}

impl Contacts {
    pub fn new(around: Surroundings, settings: ContactSettings, n: usize, t: f64) -> Self {
        Self {
            around,
            settings,
            t,
            pairs: Vec::with_capacity(MOST_PAIRS + 1),
            gradients: Vec::with_capacity((MOST_PAIRS + 1) * n),
            low: Vec::with_capacity(MOST_PAIRS + 1),
            by_time: Vec::with_capacity(MOST_PAIRS + 1),
            one: vec![0.0; n],
            memory: ProximityMemory::new(),
            limiting: Vec::with_capacity(MOST_PAIRS),
        }
    }

    /// The pairs at one configuration and their bounds for a step of `dt`.
    pub fn update(&mut self, chain: &Chain, kinematics: &Kinematics<'_>, dt: f64) {
        let alpha = self.settings.barrier_rate.min(1.0 / dt);
        self.pairs.clear();
        self.gradients.clear();
        self.by_time.clear();
        self.limiting.clear();
        // Beyond this no pair can be held back: it comes nearer by less than its bound in any step.
        let horizon = self.settings.safe_distance + CONTACT_HORIZON;
        let mut collect = Collect {
            kinematics,
            upto: horizon,
            pairs: &mut self.pairs,
            gradients: &mut self.gradients,
            by_time: &mut self.by_time,
            one: &mut self.one,
        };
        self.around.scan(kinematics, self.t, &mut self.memory, &mut collect);
        self.low.clear();
        let n = self.one.len();
        for (k, pair) in self.pairs.iter().enumerate() {
            let gradient = &self.gradients[k * n..(k + 1) * n];
            let room = pair.distance - self.settings.safe_distance;
            let mut speed = alpha * room;
            if room > 0.0 {
                let brake = |(g, joint): (&f64, &crate::chain::Joint)| match g.abs() {
                    // A joint that does not move the pair has no say.
                    size if size > CONTACT_SLOPE => size * joint.limits.acceleration,
                    _ => 0.0,
                };
                let deceleration: f64 = gradient.iter().zip(chain.joints()).map(brake).sum();
                speed = speed.min((2.0 * deceleration * room).sqrt());
            }
            self.low.push(-speed - self.by_time[k]);
        }
    }

    /// Whether a joint velocity keeps all bounds.
    pub fn contain(&self, qd: &[f64]) -> bool {
        let n = qd.len();
        self.low.iter().enumerate().all(|(k, low)| {
            let rate: f64 = self.gradients[k * n..(k + 1) * n].iter().zip(qd).map(|(g, qd)| g * qd).sum();
            rate >= *low
        })
    }

    /// Notes the pairs whose bounds `qd` is at.
    pub fn note_active(&mut self, qd: &[f64]) {
        let n = qd.len();
        for pair in 0..self.pairs.len() {
            let rate: f64 =
                self.gradients[pair * n..(pair + 1) * n].iter().zip(qd).map(|(g, qd)| g * qd).sum();
            let low = self.low[pair];
            if rate <= low + BOX_VIOLATION * (1.0 + low.abs()) {
                self.note(pair);
            }
        }
    }

    /// Notes a pair that held the step back.
    pub fn note(&mut self, pair: usize) {
        let pair = self.pairs[pair];
        if self.limiting.len() < MOST_PAIRS && !self.limiting.contains(&pair) {
            self.limiting.push(pair);
        }
    }
}

struct Collect<'a, 'k> {
    kinematics: &'a Kinematics<'k>,
    upto: f64,
    pairs: &'a mut Vec<LimitingPair>,
    gradients: &'a mut Vec<f64>,
    by_time: &'a mut Vec<f64>,
    one: &'a mut [f64],
}

impl Visitor for Collect<'_, '_> {
    fn limit(&self, _: Thing, _: Thing) -> f64 {
        self.upto
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        self.one.fill(0.0);
        contact.add_gradient(self.kinematics, 1.0, self.one);
        // What no joint moves cannot be kept away.
        if self.one.iter().all(|g| g.abs() <= CONTACT_SLOPE) {
            return true;
        }
        let distance = contact.gap.distance;
        let at = self.pairs.partition_point(|pair| pair.distance <= distance);
        let n = self.one.len();
        self.pairs.insert(at, LimitingPair { first: contact.first, second: contact.second, distance });
        self.by_time.insert(at, contact.by_time());
        let end = self.gradients.len();
        self.gradients.resize(end + n, 0.0);
        self.gradients.copy_within(at * n..end, (at + 1) * n);
        self.gradients[at * n..(at + 1) * n].copy_from_slice(self.one);
        if self.pairs.len() > MOST_PAIRS {
            self.pairs.truncate(MOST_PAIRS);
            self.by_time.truncate(MOST_PAIRS);
            self.gradients.truncate(MOST_PAIRS * n);
            self.upto = self.upto.min(self.pairs[MOST_PAIRS - 1].distance);
        }
        true
    }
}
