//! Algebra of orientation sets: intersections and unions of cones and quaternion volumes.
//!
//! # Membership and margin
//! `q` is in `A and B` where it is in both, in `A or B` where it is in one. The margin of an intersection is the least, of a
//! union the largest of its parts' margins: its sign is exact, and inside it is a lower bound of what the parts allow. Each
//! part keeps its own unit ([`QuaternionVolume::margin`] in rad, that of a [`Cone`] in the paper's).
//!
//! # Nearest member
//! Intersections of unions are written as unions of intersections, so that the nearest member is the nearest one of several
//! intersections. Of one part it is that part's. Where the nearest member of one part lies in all the others it is the one
//! sought, because the intersection is a subset of that part. Otherwise it lies on the boundaries of two parts or more:
//! Dykstra's alternating projections [BoyleDykstra1986], which give the nearest point of an intersection of convex sets,
//! from a point on the way to `q`, again and again, with the step along the edge stretched, until the edge is at right
//! angles to the way.
//!
//! # Sampling
//! Uniform with respect to the invariant measure. Every part proposes orientations uniformly with a known total measure
//! (its own members, or those of a ball around it), of which its members are kept. A union chooses a part in proportion to
//! that measure and keeps a member of m parts with the chance 1/m; an intersection takes the part with the least measure and
//! keeps what is in the others.

use nalgebra::{UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::error::{Error, Result};
use crate::rotation::cone::Cone;
use crate::rotation::quaternion::{compose, nearest_sign, rotation_angle};
use crate::rotation::volume::{Proposals, QuaternionVolume, unit_interval};
use crate::tolerance::{
    SET_APART, SET_BESIDE, SET_EDGE, SET_MEMBER, SET_SHORTEST, SET_STEP, SET_STILL, SET_STRETCH,
};

/// Draws without a member before a set counts as empty.
pub const SET_DRAWS: usize = 200_000;
/// How closely projections arrive.
struct Accuracy {
    /// Rounds of alternating projections.
    rounds: usize,
    /// Motion of a round below which they have arrived, rad.
    still: f64,
    /// Tolerance of membership.
    member: f64,
    /// Gain below which a step along an edge is made shorter, rad.
    gain: f64,
    /// Step at which the way along an edge ends, rad.
    shortest: f64,
}
const ROUGH: Accuracy = Accuracy { rounds: 30, still: 1e-4, member: 1e-3, gain: 1e-3, shortest: 1e-3 };
const CLOSE: Accuracy =
    Accuracy { rounds: 100, still: SET_STILL, member: SET_MEMBER, gain: SET_EDGE, shortest: SET_SHORTEST };
/// Steps along an edge.
const EDGE_STEPS: usize = 40;
/// Places on the edges, the nearest ones, from which these are followed.
const EDGES: usize = 6;

/// A set of orientations.
///
/// ```
/// use redundancy_core::rotation::{Cone, OrientationSet, QuaternionVolume, from_zyz};
/// let pointing = OrientationSet::from(Cone::z([0., 0., 1.], 0.3)?);
/// let turned = OrientationSet::from(QuaternionVolume::single_axis([0., 0., 1.], [-0.5, 0.5])?);
/// let tilted = OrientationSet::from(QuaternionVolume::zyz([-3., 3.], [0.2, 0.4], [-3., 3.])?);
/// let both = pointing.clone().and(tilted);
/// assert!(both.contains(&from_zyz([1.0, 0.25, 0.0]), 0.0) && !both.contains(&from_zyz([1.0, 0.1, 0.0]), 0.0));
/// assert!(both.or(turned).contains(&from_zyz([0.0, 0.0, 0.4]), 1e-9));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum OrientationSet {
    /// The tool's axis within a cone.
    Cone(Cone),
    /// A sequence of bounded rotations, or a cone.
    Volume(QuaternionVolume),
    /// What all of these have in common.
    All(Vec<OrientationSet>),
    /// What is in one of these.
    Any(Vec<OrientationSet>),
}

impl From<Cone> for OrientationSet {
    fn from(cone: Cone) -> Self {
        Self::Cone(cone)
    }
}

impl From<QuaternionVolume> for OrientationSet {
    fn from(volume: QuaternionVolume) -> Self {
        Self::Volume(volume)
    }
}

impl OrientationSet {
    /// The intersection with `other`.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self::All(joined(self, other, |set| match set {
            Self::All(parts) => parts,
            other => vec![other],
        }))
    }

    /// The union with `other`.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self::Any(joined(self, other, |set| match set {
            Self::Any(parts) => parts,
            other => vec![other],
        }))
    }

    /// Whether `q` is a member to the tolerance `tol` of each part, see [`QuaternionVolume::contains`].
    pub fn contains(&self, q: &UnitQuaternion<f64>, tol: f64) -> bool {
        match self {
            Self::Cone(cone) => cone.margin(q) >= -tol,
            Self::Volume(volume) => volume.contains(q, tol),
            Self::All(parts) => parts.iter().all(|part| part.contains(q, tol)),
            Self::Any(parts) => parts.iter().any(|part| part.contains(q, tol)),
        }
    }

    /// Signed margin, >= 0 inside: the least of an intersection's parts, the largest of a union's.
    pub fn margin(&self, q: &UnitQuaternion<f64>) -> f64 {
        match self {
            Self::Cone(cone) => cone.margin(q),
            Self::Volume(volume) => volume.margin(q),
            Self::All(parts) => parts.iter().map(|part| part.margin(q)).fold(f64::INFINITY, f64::min),
            Self::Any(parts) => parts.iter().map(|part| part.margin(q)).fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// The member nearest to `q`, on its side of the double cover; `q` itself when it is a member; `None` where no common
    /// member of an intersection was found. Of an intersection it is the best of a local search: a nearer member may exist
    /// elsewhere.
    pub fn nearest(&self, q: &UnitQuaternion<f64>) -> Option<UnitQuaternion<f64>> {
        if self.contains(q, 0.0) {
            return Some(*q);
        }
        let found = self.intersections().into_iter().filter_map(|parts| nearest_common(&parts, q));
        let best = found.min_by(|a, b| rotation_angle(a, q).total_cmp(&rotation_angle(b, q)))?;
        Some(nearest_sign(best, q))
    }

    /// The set seen from a reference frame rotated by `p`: `p * q` is in it where `q` is in this one.
    #[must_use]
    pub fn reoriented(&self, p: &UnitQuaternion<f64>) -> Self {
        let all = |parts: &[Self]| parts.iter().map(|part| part.reoriented(p)).collect();
        match self {
            Self::Cone(cone) => {
                Self::Cone(Cone::from_units(cone.body_axis(), p * cone.direction(), cone.half_angle()))
            }
            Self::Volume(volume) => Self::Volume(volume.reoriented(p)),
            Self::All(parts) => Self::All(all(parts)),
            Self::Any(parts) => Self::Any(all(parts)),
        }
    }

    /// The set of another frame of the same body, rotated by `s` in body axes: `q * s` is in it where `q` is in this one.
    #[must_use]
    pub fn reoriented_in_body(&self, s: &UnitQuaternion<f64>) -> Self {
        let all = |parts: &[Self]| parts.iter().map(|part| part.reoriented_in_body(s)).collect();
        match self {
            Self::Cone(cone) => {
                let axis = s.inverse() * cone.body_axis();
                Self::Cone(Cone::from_units(axis, cone.direction(), cone.half_angle()))
            }
            Self::Volume(volume) => Self::Volume(volume.reoriented_in_body(s)),
            Self::All(parts) => Self::All(all(parts)),
            Self::Any(parts) => Self::Any(all(parts)),
        }
    }

    /// `n` members, uniform with respect to the invariant measure (of a union of sets without volume: with respect to
    /// their angles); the same seed gives the same bits.
    ///
    /// # Errors
    /// No member among [`SET_DRAWS`] draws in a row: the set is empty, or so small beside its parts that none is met.
    pub fn sample(&self, n: usize, seed: u64) -> Result<Vec<UnitQuaternion<f64>>> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let source = Source::new(self);
        let mut members = Vec::with_capacity(n);
        let mut misses = 0;
        while members.len() < n {
            match source.draw(&mut random) {
                Some(q) => {
                    members.push(q);
                    misses = 0;
                }
                None => misses += 1,
            }
            if misses == SET_DRAWS {
                return Err(Error::Invalid(format!(
                    "no member of the set among {SET_DRAWS} draws: it is empty, or much smaller than its parts"
                )));
            }
        }
        Ok(members)
    }

    /// The set as a union of intersections of cones and volumes.
    fn intersections(&self) -> Vec<Vec<QuaternionVolume>> {
        match self {
            Self::Cone(cone) => vec![vec![QuaternionVolume::from_cone(cone)]],
            Self::Volume(volume) => vec![vec![volume.clone()]],
            Self::Any(parts) => parts.iter().flat_map(Self::intersections).collect(),
            Self::All(parts) => parts.iter().fold(vec![vec![]], |all, part| {
                let more = part.intersections();
                all.iter()
                    .flat_map(|a| more.iter().map(move |b| a.iter().chain(b).cloned().collect()))
                    .collect()
            }),
        }
    }
}

/// Parts of both, those of the same operation taken apart.
fn joined(
    a: OrientationSet,
    b: OrientationSet,
    parts: impl Fn(OrientationSet) -> Vec<OrientationSet>,
) -> Vec<OrientationSet> {
    [a, b].into_iter().flat_map(parts).collect()
}

/// A set as what proposes orientations, uniformly, with its total measure.
enum Source {
    One(Box<(QuaternionVolume, Proposals)>),
    All { first: Box<Source>, others: Vec<OrientationSet> },
    Any { parts: Vec<(Source, OrientationSet)> },
}

impl Source {
    fn new(set: &OrientationSet) -> Self {
        match set {
            OrientationSet::Cone(cone) => Self::of(QuaternionVolume::from_cone(cone)),
            OrientationSet::Volume(volume) => Self::of(volume.clone()),
            OrientationSet::All(parts) => {
                let least = (0..parts.len()).min_by(|a, b| {
                    let (a, b) = (Self::new(&parts[*a]).size(), Self::new(&parts[*b]).size());
                    a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
                });
                let least = least.unwrap_or(0);
                let others = parts.iter().enumerate().filter(|(i, _)| *i != least).map(|(_, p)| p.clone());
                Self::All { first: Box::new(Self::new(&parts[least])), others: others.collect() }
            }
            OrientationSet::Any(parts) => {
                let all: Vec<_> = parts.iter().map(|part| (Self::new(part), part.clone())).collect();
                // Sets of fewer dimensions have no measure beside the others.
                let most = all.iter().map(|(source, _)| source.size().0).max().unwrap_or(0);
                Self::Any { parts: all.into_iter().filter(|(source, _)| source.size().0 == most).collect() }
            }
        }
    }

    fn of(volume: QuaternionVolume) -> Self {
        let proposals = volume.proposals();
        Self::One(Box::new((volume, proposals)))
    }

    /// Dimension and total measure of what is proposed.
    fn size(&self) -> (usize, f64) {
        match self {
            Self::One(one) => (one.1.dimension, one.1.measure),
            Self::All { first, .. } => first.size(),
            Self::Any { parts } => parts
                .iter()
                .map(|(source, _)| source.size())
                .fold((0, 0.0), |all, part| (all.0.max(part.0), all.1 + part.1)),
        }
    }

    /// A member, or none this time.
    fn draw(&self, random: &mut ChaCha8Rng) -> Option<UnitQuaternion<f64>> {
        match self {
            Self::One(one) => one.0.propose(&one.1, random),
            Self::All { first, others } => {
                first.draw(random).filter(|q| others.iter().all(|set| set.contains(q, SET_MEMBER)))
            }
            Self::Any { parts } => {
                let mut place = unit_interval(random) * self.size().1;
                let chosen = parts.iter().position(|(source, _)| {
                    place -= source.size().1;
                    place < 0.0
                });
                let (source, _) = parts.get(chosen.unwrap_or(parts.len().saturating_sub(1)))?;
                let q = source.draw(random)?;
                let times = parts.iter().filter(|(_, set)| set.contains(&q, SET_MEMBER)).count().max(1);
                (unit_interval(random) * (times as f64) < 1.0).then_some(q)
            }
        }
    }
}

/// The common member of `parts` nearest to `q`.
fn nearest_common(parts: &[QuaternionVolume], q: &UnitQuaternion<f64>) -> Option<UnitQuaternion<f64>> {
    let inside = |p: &UnitQuaternion<f64>| parts.iter().all(|part| part.contains(p, SET_MEMBER));
    let singles: Vec<_> = parts.iter().map(|part| part.nearest(q)).collect();
    let alone = singles.iter().filter(|p| inside(p));
    if let Some(p) = alone.min_by(|a, b| rotation_angle(a, q).total_cmp(&rotation_angle(b, q))) {
        return Some(*p);
    }
    let nearest = |from: &[UnitQuaternion<f64>]| {
        let mut order = from.to_vec();
        order.sort_by(|a, b| rotation_angle(a, q).total_cmp(&rotation_angle(b, q)));
        order
    };
    // Roughly from many starts; those on the same piece of an edge would end at the same place.
    let found: Vec<_> = (starts(q, &singles).iter()).filter_map(|p| projected(parts, p, &ROUGH)).collect();
    let mut ends: Vec<UnitQuaternion<f64>> = Vec::new();
    for p in distinct(&nearest(&found), EDGES) {
        ends.push(along_the_edge(parts, p, q, &ROUGH));
    }
    // Closely from the best of them, and from the nearest members of single parts.
    let mut last = distinct(&nearest(&ends), 2);
    last.extend(std::iter::once(q).chain(&singles));
    let members = last.iter().filter_map(|p| projected(parts, p, &CLOSE));
    let ends = members.map(|p| along_the_edge(parts, p, q, &CLOSE));
    ends.min_by(|a, b| rotation_angle(a, q).total_cmp(&rotation_angle(b, q)))
}

/// The first ones of a list that are apart.
fn distinct(list: &[UnitQuaternion<f64>], most: usize) -> Vec<UnitQuaternion<f64>> {
    let mut apart: Vec<UnitQuaternion<f64>> = Vec::new();
    for p in list {
        if apart.len() < most && apart.iter().all(|other| rotation_angle(other, p) > SET_APART) {
            apart.push(*p);
        }
    }
    apart
}

/// Where the projections begin: at `q`, at the nearest members of the single parts and at rotations of `q` about the
/// diagonals of a cube in steps over half a turn. Opposite of a cone all of its rim is as near as any point of it, so that
/// the projections may lead nowhere from `q` itself; the first step is next to it.
fn starts(q: &UnitQuaternion<f64>, singles: &[UnitQuaternion<f64>]) -> Vec<UnitQuaternion<f64>> {
    let mut all = vec![*q];
    all.extend_from_slice(singles);
    for angle in [SET_BESIDE, 0.7, 1.4, 2.1, 2.8] {
        for signs in 0..8 {
            let side = |axis: usize| if signs >> axis & 1 == 0 { angle } else { -angle };
            all.push(moved(q, &(Vector3::new(side(0), side(1), side(2)) / 3.0_f64.sqrt())));
        }
    }
    all
}

/// Rotation vector, reference axes, from `from` to `to`.
fn way(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> Vector3<f64> {
    let off = compose(to, &from.inverse());
    let sine = off.imag().norm();
    if sine == 0.0 {
        return Vector3::zeros();
    }
    off.imag() * (2.0 * sine.atan2(off.w.abs()) / sine * off.w.signum())
}

fn moved(from: &UnitQuaternion<f64>, by: &Vector3<f64>) -> UnitQuaternion<f64> {
    compose(&UnitQuaternion::from_scaled_axis(*by), from)
}

/// Dykstra's alternating projections from `start`, in rotation vectors about it; `None` where they find no common member.
fn projected(
    parts: &[QuaternionVolume],
    start: &UnitQuaternion<f64>,
    accuracy: &Accuracy,
) -> Option<UnitQuaternion<f64>> {
    let mut x = Vector3::zeros();
    let mut corrections = vec![Vector3::zeros(); parts.len()];
    let inside = |p: &UnitQuaternion<f64>| parts.iter().all(|part| part.contains(p, accuracy.member));
    for round in 0..accuracy.rounds {
        let before = x;
        for (part, correction) in parts.iter().zip(&mut corrections) {
            // Far from convex the corrections may lead astray: in the second half they are left out.
            let y: Vector3<f64> = if round < accuracy.rounds / 2 { x + *correction } else { x };
            x = way(start, &part.nearest(&moved(start, &y)));
            *correction = y - x;
        }
        let p = moved(start, &x);
        if (x - before).norm() <= accuracy.still && inside(&p) {
            return Some(p);
        }
    }
    let p = moved(start, &x);
    inside(&p).then_some(p)
}

/// From a common member to one from which no other along the boundaries is nearer to `q`.
fn along_the_edge(
    parts: &[QuaternionVolume],
    mut p: UnitQuaternion<f64>,
    q: &UnitQuaternion<f64>,
    accuracy: &Accuracy,
) -> UnitQuaternion<f64> {
    let mut longest = SET_STEP;
    for _ in 0..EDGE_STEPS {
        let distance = rotation_angle(&p, q);
        if longest < accuracy.shortest || distance < accuracy.shortest {
            break;
        }
        let share = (longest / distance).min(0.5);
        let near = projected(parts, &moved(&p, &(way(&p, q) * share)), accuracy);
        // The step along the edge is the share of what is left of it.
        let stretched = near.and_then(|near| {
            let step = way(&p, &near) / share;
            projected(parts, &moved(&p, &(step * (SET_STRETCH / step.norm()).min(1.0))), accuracy)
        });
        let candidates = [near, stretched].into_iter().flatten();
        let best = candidates.min_by(|a, b| rotation_angle(a, q).total_cmp(&rotation_angle(b, q)));
        match best.filter(|best| rotation_angle(best, q) < distance - accuracy.gain) {
            Some(best) => p = best,
            None => longest *= 0.1,
        }
    }
    p
}
