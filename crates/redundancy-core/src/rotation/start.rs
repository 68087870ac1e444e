//! A feasible start, or the angle by which the sets miss each other.
//!
//! The barrier methods need a start inside of every set, which [FromGravdahl2009, section VII] leaves as future work.
//! Here the least margin is maximised: with `s_i` the margins, normalised to 1 on a cone's axis, the smooth lower
//! bound `-tau log sum_i exp(-s_i / tau)` is climbed on the rotation group by Newton's method while `tau` shrinks,
//! until every `s_i` is positive. Spins enter as the form `r0^2 - (r3 / kappa)^2`, which has the same sign as their
//! margin and no pole. The climb starts from the orientations that satisfy one constraint exactly and a second one
//! as well as then possible; if none leads inside, from the 24 rotations of the cube.
//!
//! When the climb ends outside, the largest angle by which a constraint is exceeded is minimised the same way.
//! The **miss angle** is twice that: for two cones on one axis it is the angle between their rims. For each pair of
//! cones (body axes at `phi_b`, directions at `phi_d`) the exact miss is `|phi_b - phi_d| - theta_1 - theta_2`; where
//! the worst pair explains the measured one, its value is returned. With three constraints or more that hold in pairs
//! the verdict rests on the search, and the miss angle is an upper bound.

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

use crate::rotation::barrier::{Barrier, Model};
use crate::rotation::cone::{Cone, Constraint, Local, Spin};
use crate::rotation::newton::{descent_direction, retract};
use crate::rotation::quaternion::{about, angle_between, compose, nearest_sign, shortest_arc, swing_twist};
use crate::tolerance::{MISS_AGREES, START_MARGIN, START_SMOOTHING, SUFFICIENT_DECREASE};

/// What the search found.
pub(crate) enum Start {
    /// An orientation inside of every set.
    Inside(UnitQuaternion<f64>),
    /// The least bad orientation and the miss angle, rad.
    Outside(UnitQuaternion<f64>, f64),
}

/// What is made as large as possible for the worst constraint.
#[derive(Clone, Copy, PartialEq)]
enum Measure {
    /// The normalised margin.
    Margin,
    /// Minus the angle by which it is exceeded.
    Angle,
}

const SMOOTHING_START: f64 = 0.5;
const SMOOTHING_FACTOR: f64 = 0.2;
const STEPS_PER_STAGE: usize = 12;
const HALVINGS: usize = 30;

/// The search; `hint` is tried first.
pub(crate) fn find(barriers: &[Barrier], hint: Option<&UnitQuaternion<f64>>) -> Start {
    let mut best: Option<(f64, UnitQuaternion<f64>)> = None;
    let mut consider = |q: UnitQuaternion<f64>| {
        let score = least(barriers, &q, Measure::Margin);
        if best.is_none_or(|(value, _)| score > value) {
            best = Some((score, q));
        }
    };
    hint.into_iter().copied().chain(seeds(barriers)).for_each(&mut consider);
    let mut outside = match best {
        None => UnitQuaternion::identity(),
        Some((_, q)) => match climb_inside(barriers, q) {
            Ok(inside) => return Start::Inside(inside),
            Err(q) => q,
        },
    };
    let exact = worst_pair(barriers);
    if exact <= 0.0 {
        for q in cube_rotations() {
            match climb_inside(barriers, q) {
                Ok(inside) => return Start::Inside(inside),
                Err(q) => {
                    if least(barriers, &q, Measure::Margin) > least(barriers, &outside, Measure::Margin) {
                        outside = q;
                    }
                }
            }
        }
    }
    let mut tau = SMOOTHING_START;
    while tau > START_SMOOTHING {
        outside = climb(barriers, outside, tau, Measure::Angle);
        tau *= SMOOTHING_FACTOR;
    }
    let measured = -2.0 * least(barriers, &outside, Measure::Angle);
    let miss = if (measured - exact).abs() <= MISS_AGREES { exact } else { measured };
    Start::Outside(outside, miss.max(0.0))
}

/// The orientations that satisfy one constraint exactly, and a second one as well as then possible.
pub(crate) fn seeds(barriers: &[Barrier]) -> impl Iterator<Item = UnitQuaternion<f64>> + '_ {
    barriers.iter().flat_map(move |first| {
        let aligned = align_first(first.constraint());
        let pairs = move |second: &Barrier| align_second(first.constraint(), second.constraint(), &aligned);
        std::iter::once(aligned).chain(barriers.iter().map(pairs))
    })
}

/// Climbs from `q` until every margin is positive and the worst one no longer gains much.
fn climb_inside(
    barriers: &[Barrier],
    mut q: UnitQuaternion<f64>,
) -> Result<UnitQuaternion<f64>, UnitQuaternion<f64>> {
    let mut tau = SMOOTHING_START;
    while tau > START_SMOOTHING {
        let score = least(barriers, &q, Measure::Margin);
        if score >= START_MARGIN || score >= 2.0 * tau {
            break;
        }
        q = climb(barriers, q, tau, Measure::Margin);
        tau *= SMOOTHING_FACTOR;
    }
    // The verdict is that of the margins themselves: theirs are the barriers.
    if barriers.iter().all(|b| b.constraint().margin(&q) > 0.0) { Ok(q) } else { Err(q) }
}

/// Newton's method on the smoothed minimum with one smoothing.
fn climb(
    barriers: &[Barrier],
    mut q: UnitQuaternion<f64>,
    tau: f64,
    measure: Measure,
) -> UnitQuaternion<f64> {
    let mut value = smoothed(barriers, &q, tau, measure);
    for _ in 0..STEPS_PER_STAGE {
        let model = smoothed_model(barriers, &q, tau, measure, value);
        let step = descent_direction(&model);
        let decrease = -model.gradient.dot(&step);
        // Below a hundredth of the smoothing nothing is left to gain.
        if decrease.is_nan() || decrease <= 1e-2 * SUFFICIENT_DECREASE * tau {
            break;
        }
        let mut length = 1.0;
        let mut moved = false;
        for _ in 0..HALVINGS {
            let trial = retract(&q, &(step * length));
            let trial_value = smoothed(barriers, &trial, tau, measure);
            if trial_value >= value + SUFFICIENT_DECREASE * length * decrease {
                (q, value, moved) = (trial, trial_value, true);
                break;
            }
            length *= 0.5;
        }
        if !moved {
            break;
        }
    }
    q
}

/// The worst constraint's measure.
fn least(barriers: &[Barrier], q: &UnitQuaternion<f64>, measure: Measure) -> f64 {
    barriers.iter().map(|b| amount(b.constraint(), q, measure)).fold(f64::INFINITY, f64::min)
}

/// `-tau log sum exp(-s_i / tau)`.
fn smoothed(barriers: &[Barrier], q: &UnitQuaternion<f64>, tau: f64, measure: Measure) -> f64 {
    let low = least(barriers, q, measure);
    let sum: f64 = barriers.iter().map(|b| ((low - amount(b.constraint(), q, measure)) / tau).exp()).sum();
    low - tau * sum.ln()
}

/// Gradient and Hessian of minus the smoothed minimum, whose value is `value`.
fn smoothed_model(
    barriers: &[Barrier],
    q: &UnitQuaternion<f64>,
    tau: f64,
    measure: Measure,
    value: f64,
) -> Model {
    let mut mean = Vector3::zeros();
    let mut hessian = [0.0; 6];
    for barrier in barriers {
        let Local { margin, gradient: g, hessian: h } = local(barrier.constraint(), q, measure);
        let weight = ((value - margin) / tau).exp();
        mean += g * weight;
        let outer = outer(&g);
        for i in 0..6 {
            hessian[i] += weight * (outer[i] / tau - h[i]);
        }
    }
    let correction = outer(&mean);
    for i in 0..6 {
        hessian[i] -= correction[i] / tau;
    }
    Model { gradient: -mean, hessian }
}

fn outer(g: &Vector3<f64>) -> [f64; 6] {
    [g.x * g.x, g.x * g.y, g.x * g.z, g.y * g.y, g.y * g.z, g.z * g.z]
}

fn amount(constraint: &Constraint, q: &UnitQuaternion<f64>, measure: Measure) -> f64 {
    match (measure, constraint) {
        (Measure::Angle, _) => -constraint.excess(q),
        (Measure::Margin, Constraint::Cone(cone)) => cone.margin(q) / cone.scale(),
        (Measure::Margin, Constraint::Spin(spin)) => spin_form(spin, q).margin,
    }
}

fn local(constraint: &Constraint, q: &UnitQuaternion<f64>, measure: Measure) -> Local {
    match (measure, constraint) {
        (Measure::Margin, Constraint::Cone(cone)) => {
            let l = cone.local(&q.to_rotation_matrix().into_inner());
            let scale = 1.0 / cone.scale();
            Local {
                margin: l.margin * scale,
                gradient: l.gradient * scale,
                hessian: l.hessian.map(|x| x * scale),
            }
        }
        (Measure::Margin, Constraint::Spin(spin)) => spin_form(spin, q),
        (Measure::Angle, Constraint::Cone(cone)) => {
            // theta = acos(2 m + cos half_angle): its derivatives from those of m.
            let l = cone.local(&q.to_rotation_matrix().into_inner());
            let theta = cone.angle(q);
            let sine = theta.sin().max(MISS_AGREES);
            let gradient = l.gradient * (2.0 / sine);
            let (cot, o) = (theta.cos() / sine, outer(&gradient));
            let mut hessian = l.hessian.map(|x| 2.0 * x / sine);
            for i in 0..6 {
                hessian[i] += cot * o[i];
            }
            Local { margin: cone.half_angle() - theta, gradient, hessian }
        }
        (Measure::Angle, Constraint::Spin(spin)) => {
            // m = kappa^2 - t^2 and |twist| = 2 atan |t|, so d|twist| = -dm / (|t| (1 + t^2)).
            let l = spin.local(q);
            let theta = spin.twist(q).abs();
            let t = (0.5 * theta).tan().max(MISS_AGREES);
            let scale = 1.0 / (t * (1.0 + t * t));
            let gradient = l.gradient * scale;
            let (bend, o) = ((1.0 + 3.0 * t * t) / (2.0 * t), outer(&gradient));
            let mut hessian = l.hessian.map(|x| x * scale);
            for i in 0..6 {
                hessian[i] += bend * o[i];
            }
            Local { margin: spin.max_angle() - theta, gradient, hessian }
        }
    }
}

/// `r0^2 - (r3 / kappa)^2`: the sign of a spin's margin without its pole.
fn spin_form(spin: &Spin, q: &UnitQuaternion<f64>) -> Local {
    let r = spin.reference().as_ref().conjugate() * q.as_ref();
    let (v, n) = (r.imag(), spin.axis().into_inner());
    let along = v.dot(&n);
    let inverse = 1.0 / spin.kappa2();
    let (scalar, twist) = (-0.5 * v, 0.5 * (n * r.w + n.cross(&v)));
    let margin = r.w * r.w - along * along * inverse;
    let mut hessian = [0.0; 6];
    let (a, b) = (outer(&scalar), outer(&twist));
    for i in 0..6 {
        hessian[i] = 2.0 * (a[i] - b[i] * inverse);
    }
    for i in [0, 3, 5] {
        hessian[i] -= 0.5 * margin;
    }
    Local { margin, gradient: 2.0 * (scalar * r.w - twist * (along * inverse)), hessian }
}

/// An orientation at which a constraint holds best.
fn align_first(constraint: &Constraint) -> UnitQuaternion<f64> {
    match constraint {
        Constraint::Cone(cone) => shortest_arc(&cone.body_axis(), &cone.direction()),
        Constraint::Spin(spin) => spin.reference(),
    }
}

/// Turns `aligned`, where `first` holds best, so that `first` stays as it is and `second` holds as well as possible.
fn align_second(
    first: &Constraint,
    second: &Constraint,
    aligned: &UnitQuaternion<f64>,
) -> UnitQuaternion<f64> {
    match (first, second) {
        (Constraint::Cone(one), Constraint::Cone(two)) => {
            let axis = one.direction();
            turn(aligned, &axis, &(aligned * two.body_axis()), &two.direction())
        }
        (Constraint::Cone(one), Constraint::Spin(two)) => {
            // Towards the reference about the cone's axis: the twist of reference * conj(aligned).
            let towards = compose(&two.reference(), &aligned.inverse());
            compose(&swing_twist(&towards, &one.direction()).1, aligned)
        }
        (Constraint::Spin(_), Constraint::Cone(two)) => {
            compose(&shortest_arc(&(aligned * two.body_axis()), &two.direction()), aligned)
        }
        (Constraint::Spin(_), Constraint::Spin(two)) => halfway(aligned, &two.reference()),
    }
}

/// Half-way between two orientations.
fn halfway(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    Unit::new_normalize(a.as_ref() + nearest_sign(*b, a).as_ref())
}

/// Rotates `q` about the world axis `axis` so that `from` comes as near to `to` as it can.
fn turn(
    q: &UnitQuaternion<f64>,
    axis: &Unit<Vector3<f64>>,
    from: &Unit<Vector3<f64>>,
    to: &Unit<Vector3<f64>>,
) -> UnitQuaternion<f64> {
    let sine = axis.dot(&from.cross(to));
    let cosine = from.dot(to) - axis.dot(from) * axis.dot(to);
    compose(&about(axis, sine.atan2(cosine)), q)
}

/// The largest exact miss angle, rad, of a pair of cones; negative when every pair meets.
fn worst_pair(barriers: &[Barrier]) -> f64 {
    let mut worst = f64::NEG_INFINITY;
    for (i, one) in barriers.iter().enumerate() {
        for two in &barriers[i + 1..] {
            if let (Constraint::Cone(one), Constraint::Cone(two)) = (one.constraint(), two.constraint()) {
                worst = worst.max(pair_miss(one, two));
            }
        }
    }
    worst
}

/// `|phi_b - phi_d| - theta_1 - theta_2`: the angle by which two cones miss each other, negative when they meet.
fn pair_miss(one: &Cone, two: &Cone) -> f64 {
    let body = angle_between(&one.body_axis(), &two.body_axis());
    let world = angle_between(&one.direction(), &two.direction());
    (body - world).abs() - one.half_angle() - two.half_angle()
}

/// The 24 rotations of the cube.
fn cube_rotations() -> impl Iterator<Item = UnitQuaternion<f64>> {
    // Every sign pattern over {0, 1}^4 patterns of one, two or four non-zero entries, one of each pair +-q.
    (0..81u32).filter_map(|code| {
        let entry = |i: u32| f64::from((code / 3_u32.pow(i)) % 3) - 1.0;
        let entries = [entry(0), entry(1), entry(2), entry(3)];
        let count = entries.iter().filter(|x| **x != 0.0).count();
        let leading = entries.iter().find(|x| **x != 0.0).copied().unwrap_or(0.0);
        (count != 0 && count != 3 && leading > 0.0)
            .then(|| Unit::new_normalize(Quaternion::new(entries[0], entries[1], entries[2], entries[3])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cube_has_24_rotations() {
        let all: Vec<_> = cube_rotations().collect();
        assert_eq!(all.len(), 24);
        for (i, a) in all.iter().enumerate() {
            assert!(all[i + 1..].iter().all(|b| a.angle_to(b) > 0.5));
        }
    }

    /// Every measure's gradient and Hessian against central differences.
    #[test]
    fn measures_have_their_derivatives() {
        let spin = Spin::new(UnitQuaternion::from_euler_angles(0.2, 0.1, 0.3), 0.9, [0.2, 0.1, 1.0]).unwrap();
        let cone = Cone::new([0.1, 0.3, 1.0], [0.4, 0.2, -0.3], 0.4).unwrap();
        let q = UnitQuaternion::from_euler_angles(-0.5, 0.7, 1.1);
        for constraint in [Constraint::from(spin), Constraint::from(cone)] {
            for measure in [Measure::Margin, Measure::Angle] {
                let l = local(&constraint, &q, measure);
                assert!((l.margin - amount(&constraint, &q, measure)).abs() < 1e-14);
                let at = |d: Vector3<f64>| {
                    amount(&constraint, &(q * UnitQuaternion::from_scaled_axis(d)), measure)
                };
                let h = crate::rotation::cone::unpack(&l.hessian);
                let e = 1e-4;
                for i in 0..3 {
                    let ei = Vector3::ith(i, e);
                    let slope = (at(ei) - at(-ei)) / (2.0 * e);
                    assert!((slope - l.gradient[i]).abs() < 1e-7, "{measure:?}");
                    for j in 0..3 {
                        let ej = Vector3::ith(j, e);
                        let bend = (at(ei + ej) - at(ei - ej) - at(ej - ei) + at(-ei - ej)) / (4.0 * e * e);
                        assert!((bend - h[(i, j)]).abs() < 1e-6, "{measure:?} {i}{j}: {bend} {}", h[(i, j)]);
                    }
                }
            }
        }
    }

    impl std::fmt::Debug for Measure {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str(if *self == Self::Margin { "margin" } else { "angle" })
        }
    }
}
