//! Helpers for the entries of the catalogue.

use nalgebra::{Matrix3, Vector3};

use super::dh::DhRow;
use super::joint::{Inertia, Limits};
use crate::pose::{Pose, pose};

/// One [`Limits`] per joint; an empty list means that there is no such limit.
pub(super) fn limits(
    lower: &[f64],
    upper: &[f64],
    velocity: &[f64],
    acceleration: &[f64],
    effort: &[f64],
) -> Vec<Limits> {
    let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(f64::INFINITY);
    let joint = |(i, (lower, upper)): (usize, (&f64, &f64))| Limits {
        lower: *lower,
        upper: *upper,
        velocity: at(velocity, i),
        acceleration: at(acceleration, i),
        effort: at(effort, i),
    };
    lower.iter().zip(upper).enumerate().map(joint).collect()
}

pub(super) fn row(a: f64, d: f64, alpha: f64) -> DhRow {
    DhRow { a, d, alpha, theta: 0.0 }
}

pub(super) fn along_z(height: f64) -> Pose {
    pose(Matrix3::identity(), Vector3::new(0.0, 0.0, height))
}

pub(super) fn diagonal(mass: f64, center_of_mass: [f64; 3], [x, y, z]: [f64; 3]) -> Inertia {
    body(mass, center_of_mass, [x, y, z, 0.0, 0.0, 0.0])
}

pub(super) fn body(mass: f64, center_of_mass: [f64; 3], [xx, yy, zz, xy, xz, yz]: [f64; 6]) -> Inertia {
    let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    Inertia { mass, center_of_mass: center_of_mass.into(), tensor, rotor: 0.0 }
}
