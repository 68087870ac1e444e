//! What the constraints of a barrier problem have in common: cones on one body axis, a spin alone, and the rotations that
//! change no margin.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

use crate::rotation::arc::{TwoCones, on_arc};
use crate::rotation::barrier::Barrier;
use crate::rotation::cone::{Cone, Constraint, Spin};
use crate::rotation::quaternion::{angle_between, compose, half_turn, nearest_sign, shortest_arc};
use crate::tolerance::{ANGLE_PART, SAME_AXIS};

/// What the constraints' structure allows.
#[derive(Debug, Clone, Copy)]
pub(super) enum Structure {
    /// One or two cones on one body axis; `spin` about the same axis.
    Axis {
        axis: Unit<Vector3<f64>>,
        first: Unit<Vector3<f64>>,
        second: Option<SecondCone>,
        spin: Option<Spin>,
    },
    /// A spin alone.
    Twist(Spin),
    /// Anything else.
    General,
}

/// The second cone of an axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct SecondCone {
    pub direction: Unit<Vector3<f64>>,
    /// The closed form, when both half-angles are below 90 degrees.
    pub cones: Option<TwoCones>,
    /// Half-angles of the first and the second cone.
    pub half_angles: [f64; 2],
}

/// A rotation that changes no margin.
#[derive(Debug, Clone, Copy)]
pub(super) enum Symmetry {
    None,
    /// About this body axis.
    Body(Unit<Vector3<f64>>),
    /// About this direction.
    World(Unit<Vector3<f64>>),
}

/// Where the arcs `|t| < beta` and `|t - omega| < alpha` of the great circle through both directions overlap: the
/// middles of the one or two intervals. Each holds exactly one critical point, as both terms are convex along it.
pub(super) fn wide_middles(
    u: &Unit<Vector3<f64>>,
    c: &Unit<Vector3<f64>>,
    [beta, alpha]: [f64; 2],
) -> [Option<Unit<Vector3<f64>>>; 2] {
    let omega = angle_between(u, c);
    let middle = |centre: f64| {
        let (low, high) = ((-beta).max(centre - alpha), beta.min(centre + alpha));
        (low < high).then(|| on_arc(u, c, 0.5 * (low + high)))
    };
    [middle(omega), middle(omega - std::f64::consts::TAU)]
}

/// The zero twist nearest to `q0`, or the reference itself.
pub(super) fn without_twist(spin: &Spin, q0: Option<&UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
    let reference = spin.reference();
    let Some(q0) = q0 else { return reference };
    let r = reference.as_ref().conjugate() * q0.as_ref();
    let axis = spin.axis().into_inner();
    let v = r.imag() - axis * r.imag().dot(&axis);
    let norm = r.w.hypot(v.norm());
    if norm < ANGLE_PART {
        return nearest_sign(reference, q0);
    }
    compose(&reference, &Unit::new_normalize(Quaternion::new(r.w, v.x, v.y, v.z)))
}

/// +1 or -1 when the unit vectors are parallel or opposite.
fn alignment(a: &Unit<Vector3<f64>>, b: &Unit<Vector3<f64>>) -> Option<f64> {
    if (a.into_inner() - b.into_inner()).norm() <= SAME_AXIS {
        Some(1.0)
    } else if (a.into_inner() + b.into_inner()).norm() <= SAME_AXIS {
        Some(-1.0)
    } else {
        None
    }
}

/// The cone's direction as seen from `axis`, when its body axis is `axis` or `-axis`.
fn direction_on(cone: &Cone, axis: &Unit<Vector3<f64>>) -> Option<Unit<Vector3<f64>>> {
    alignment(&cone.body_axis(), axis)
        .map(|sign| if sign > 0.0 { cone.direction() } else { -cone.direction() })
}

pub(super) fn structure_of(barriers: &[Barrier]) -> Structure {
    let mut cones: [Option<(Cone, f64)>; 2] = [None, None];
    let mut spin = None;
    for barrier in barriers {
        match barrier.constraint() {
            Constraint::Cone(cone) if cones[0].is_none() => cones[0] = Some((*cone, barrier.weight())),
            Constraint::Cone(cone) if cones[1].is_none() => cones[1] = Some((*cone, barrier.weight())),
            Constraint::Spin(s) if spin.is_none() => spin = Some(*s),
            _ => return Structure::General,
        }
    }
    let Some((one, k1)) = cones[0] else {
        return spin.map_or(Structure::General, Structure::Twist);
    };
    let axis = one.body_axis();
    if spin.is_some_and(|s| alignment(&s.axis(), &axis).is_none()) {
        return Structure::General;
    }
    let second = match &cones[1] {
        None => None,
        Some((two, k2)) => {
            let Some(direction) = direction_on(two, &axis) else { return Structure::General };
            let half_angles = [one.half_angle(), two.half_angle()];
            let convex = half_angles.iter().all(|a| *a < FRAC_PI_2);
            let cones = convex.then(|| TwoCones::from_checked(half_angles[0], half_angles[1], k1, *k2));
            Some(SecondCone { direction, cones, half_angles })
        }
    };
    Structure::Axis { axis, first: one.direction(), second, spin }
}

pub(super) fn symmetry_of(barriers: &[Barrier]) -> Symmetry {
    let Constraint::Cone(one) = barriers[0].constraint() else { return Symmetry::None };
    let all = |test: &dyn Fn(&Cone) -> bool| {
        barriers.iter().all(|b| matches!(b.constraint(), Constraint::Cone(cone) if test(cone)))
    };
    if all(&|cone| alignment(&cone.body_axis(), &one.body_axis()).is_some()) {
        Symmetry::Body(one.body_axis())
    } else if all(&|cone| alignment(&cone.direction(), &one.direction()).is_some()) {
        Symmetry::World(one.direction())
    } else {
        Symmetry::None
    }
}

/// `swing(-b -> d) * half_turn(b)`: the body axis points along the first cone's direction.
pub(super) fn base_of(axis: &Unit<Vector3<f64>>, barriers: &[Barrier]) -> UnitQuaternion<f64> {
    let flip = half_turn(axis);
    match barriers[0].constraint() {
        Constraint::Cone(cone) => compose(&shortest_arc(&-*axis, &cone.direction()), &flip),
        Constraint::Spin(_) => flip,
    }
}
