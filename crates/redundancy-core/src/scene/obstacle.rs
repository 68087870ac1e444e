//! Obstacles: spheres, boxes, capsules, standing or moving in a straight line.

use std::fmt;

use nalgebra::Vector3;

use crate::error::{Error, Result, check_finite};
use crate::pose::{Pose, check_pose};
use crate::tolerance::SCENE_SIZE;

/// A ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Its centre in the world, m.
    pub center: Vector3<f64>,
    /// Its radius, m.
    pub radius: f64,
}

/// A box with any orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Its centre and its axes in the world.
    pub pose: Pose,
    /// Half of its edges, m.
    pub half_extents: Vector3<f64>,
}

/// All points within `radius` of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// One end of the segment in the world, m.
    pub start: Vector3<f64>,
    /// The other end, m.
    pub end: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

/// The form of an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere(Sphere),
    /// A box.
    Box(Cuboid),
    /// A capsule.
    Capsule(Capsule),
}

/// A shape in the world, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstacle {
    /// Its form and place at time 0.
    pub shape: Shape,
    /// Its velocity, m/s; it does not turn.
    pub velocity: Vector3<f64>,
}

impl Shape {
    /// The word of files and messages.
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::Sphere(_) => "sphere",
            Self::Box(_) => "box",
            Self::Capsule(_) => "capsule",
        }
    }

    /// Checks its numbers.
    ///
    /// # Errors
    /// Entries that are not finite, a radius or half extent that is negative, a pose that is not rigid.
    pub fn validate(&self) -> Result<()> {
        // Squares of what is further away or larger would overflow, and a collision read as clear.
        let near = |what: &str, values: &[f64]| {
            check_finite(what, values)?;
            match values.iter().find(|value| value.abs() > SCENE_SIZE) {
                Some(value) => {
                    let bound = format!("within +-{SCENE_SIZE:e} m");
                    Err(Error::OutOfRange { what: what.into(), value: *value, bound })
                }
                None => Ok(()),
            }
        };
        let size = |what: &str, value: f64| {
            check_finite(what, &[value])?;
            if value < 0.0 {
                return Err(Error::OutOfRange { what: what.into(), value, bound: ">= 0 m".into() });
            }
            near(what, &[value])
        };
        match self {
            Self::Sphere(sphere) => {
                near("center", sphere.center.as_slice())?;
                size("radius", sphere.radius)
            }
            Self::Box(cuboid) => {
                check_pose("pose", &cuboid.pose)?;
                near("position", cuboid.pose.translation.vector.as_slice())?;
                cuboid
                    .half_extents
                    .iter()
                    .zip("xyz".chars())
                    .try_for_each(|(value, axis)| size(&format!("half extent {axis}"), *value))
            }
            Self::Capsule(capsule) => {
                near("start", capsule.start.as_slice())?;
                near("end", capsule.end.as_slice())?;
                size("radius", capsule.radius)
            }
        }
    }

    /// The same shape elsewhere.
    #[must_use]
    pub fn moved(&self, by: &Vector3<f64>) -> Self {
        let mut shape = *self;
        match &mut shape {
            Self::Sphere(sphere) => sphere.center += by,
            Self::Box(cuboid) => cuboid.pose.translation.vector += by,
            Self::Capsule(capsule) => {
                capsule.start += by;
                capsule.end += by;
            }
        }
        shape
    }

    /// A ball around it: centre and radius.
    pub fn bounding_ball(&self) -> (Vector3<f64>, f64) {
        match self {
            Self::Sphere(sphere) => (sphere.center, sphere.radius),
            Self::Box(cuboid) => (cuboid.pose.translation.vector, cuboid.half_extents.norm()),
            Self::Capsule(capsule) => {
                let middle = 0.5 * (capsule.start + capsule.end);
                (middle, 0.5 * (capsule.end - capsule.start).norm() + capsule.radius)
            }
        }
    }
}

impl Obstacle {
    /// An obstacle that stands.
    ///
    /// # Errors
    /// As [`Shape::validate`].
    pub fn fixed(shape: Shape) -> Result<Self> {
        Self::moving(shape, Vector3::zeros())
    }

    /// An obstacle that moves.
    ///
    /// # Errors
    /// As [`Shape::validate`], or a velocity that is not finite.
    pub fn moving(shape: Shape, velocity: Vector3<f64>) -> Result<Self> {
        shape.validate()?;
        check_finite("velocity", velocity.as_slice())?;
        Ok(Self { shape, velocity })
    }

    /// Where it is at time `t`, s.
    #[must_use]
    pub fn at(&self, t: f64) -> Self {
        Self { shape: self.shape.moved(&(self.velocity * t)), velocity: self.velocity }
    }
}

impl From<Sphere> for Shape {
    fn from(sphere: Sphere) -> Self {
        Self::Sphere(sphere)
    }
}

impl From<Cuboid> for Shape {
    fn from(cuboid: Cuboid) -> Self {
        Self::Box(cuboid)
    }
}

impl From<Capsule> for Shape {
    fn from(capsule: Capsule) -> Self {
        Self::Capsule(capsule)
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
