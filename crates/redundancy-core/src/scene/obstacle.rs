//! Obstacles: what they are, where they stand or how they move in a straight line, what they are fixed to.

use std::fmt;

use nalgebra::{Rotation3, Vector3};

use super::core_shape::Core;
use super::mesh_obstacle::Mesh;
use super::solid::Solid;
use crate::chain::axis_onto_z;
use crate::error::{Error, Result, check_finite};
use crate::pose::{Pose, check_pose, pose};
use crate::tolerance::{DIRECTION_NORM, SCENE_SIZE};

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

/// A cylinder with any orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// Its centre and its axes in the world; it is round about z.
    pub pose: Pose,
    /// Radius, m.
    pub radius: f64,
    /// Half of its length, m.
    pub half_length: f64,
}

/// Everything on one side of a plane: a floor, a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// A point of the plane in the world, m.
    pub point: Vector3<f64>,
    /// Away from the solid side; its length does not matter.
    pub normal: Vector3<f64>,
}

/// The form of an obstacle.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere(Sphere),
    /// A box.
    Box(Cuboid),
    /// A capsule.
    Capsule(Capsule),
    /// A cylinder.
    Cylinder(Cylinder),
    /// A half-space.
    HalfSpace(HalfSpace),
    /// Triangles.
    Mesh(Mesh),
}

/// A shape, its name, how it moves or what it is fixed to.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Its form and place at time 0, in the world; in the frame of the link where it is attached to one.
    pub shape: Shape,
    /// Its velocity, m/s; it does not turn.
    pub velocity: Vector3<f64>,
    /// Its name, if it has one.
    pub name: Option<String>,
    /// The link that carries it, if one does.
    pub attached_to: Option<String>,
}

impl Shape {
    /// The word of files and messages.
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::Sphere(_) => "sphere",
            Self::Box(_) => "box",
            Self::Capsule(_) => "capsule",
            Self::Cylinder(_) => "cylinder",
            Self::HalfSpace(_) => "half_space",
            Self::Mesh(_) => "mesh",
        }
    }

    /// Checks its numbers.
    ///
    /// # Errors
    /// Entries that are not finite, a radius, length or half extent that is negative, a pose that is not rigid, a normal
    /// without length.
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
            Self::Cylinder(cylinder) => {
                check_pose("pose", &cylinder.pose)?;
                near("position", cylinder.pose.translation.vector.as_slice())?;
                size("radius", cylinder.radius)?;
                size("half length", cylinder.half_length)
            }
            Self::HalfSpace(half_space) => {
                near("point", half_space.point.as_slice())?;
                near("normal", half_space.normal.as_slice())?;
                let (norm, minimum) = (half_space.normal.norm(), DIRECTION_NORM);
                if norm < minimum {
                    return Err(Error::ZeroDirection { what: "normal".into(), norm, minimum });
                }
                Ok(())
            }
            // Its vertices were checked when it was made.
            Self::Mesh(mesh) => {
                check_pose("pose", &mesh.pose)?;
                near("position", mesh.pose.translation.vector.as_slice())
            }
        }
    }

    /// The same shape elsewhere.
    #[must_use]
    pub fn moved(&self, by: &Vector3<f64>) -> Self {
        let mut shape = self.clone();
        match &mut shape {
            Self::Sphere(sphere) => sphere.center += by,
            Self::Box(cuboid) => cuboid.pose.translation.vector += by,
            Self::Capsule(capsule) => {
                capsule.start += by;
                capsule.end += by;
            }
            Self::Cylinder(cylinder) => cylinder.pose.translation.vector += by,
            Self::HalfSpace(half_space) => half_space.point += by,
            Self::Mesh(mesh) => mesh.pose.translation.vector += by,
        }
        shape
    }

    /// Whether it can be fixed to a link: half-spaces cannot, nor meshes that count triangle by triangle.
    pub(crate) fn is_convex(&self) -> bool {
        match self {
            Self::HalfSpace(_) => false,
            Self::Mesh(mesh) => mesh.pieces() > 0,
            _ => true,
        }
    }

    /// What distances are computed with.
    pub(crate) fn solids(&self) -> Vec<Solid> {
        let at = |position: Vector3<f64>| Pose::translation(position.x, position.y, position.z);
        match self {
            Self::Sphere(sphere) => vec![Solid::convex(Core::Point, &at(sphere.center), sphere.radius)],
            Self::Box(cuboid) => vec![Solid::convex(Core::Box(cuboid.half_extents), &cuboid.pose, 0.0)],
            Self::Capsule(capsule) => {
                vec![Solid::capsule(&capsule.start, &capsule.end, capsule.radius)]
            }
            Self::Cylinder(cylinder) => {
                let core = Core::Cylinder { radius: cylinder.radius, half: cylinder.half_length };
                vec![Solid::convex(core, &cylinder.pose, 0.0)]
            }
            Self::HalfSpace(half_space) => {
                let up = axis_onto_z(&(half_space.normal / half_space.normal.norm()));
                vec![Solid::half_space(&pose(
                    *Rotation3::from_matrix_unchecked(up).matrix(),
                    half_space.point,
                ))]
            }
            Self::Mesh(mesh) => mesh.solids(),
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
        let obstacle = Self { shape, velocity, name: None, attached_to: None };
        obstacle.validate()?;
        Ok(obstacle)
    }

    /// With a name.
    ///
    /// # Errors
    /// An empty name.
    pub fn named(mut self, name: impl Into<String>) -> Result<Self> {
        self.name = Some(name.into());
        self.validate()?;
        Ok(self)
    }

    /// Fixed to a link: its shape counts in the frame of that link.
    ///
    /// # Errors
    /// A velocity; a half-space or a mesh that counts triangle by triangle.
    pub fn attached_to(mut self, link: impl Into<String>) -> Result<Self> {
        self.attached_to = Some(link.into());
        self.validate()?;
        Ok(self)
    }

    /// Checks everything.
    ///
    /// # Errors
    /// As of the functions that make it.
    pub fn validate(&self) -> Result<()> {
        self.shape.validate()?;
        check_finite("velocity", self.velocity.as_slice())?;
        if self.name.as_deref() == Some("") {
            return Err(Error::Invalid("name is empty".into()));
        }
        let Some(link) = &self.attached_to else { return Ok(()) };
        if self.velocity != Vector3::zeros() {
            return Err(Error::Invalid(format!("is attached to '{link}', so it has no velocity of its own")));
        }
        if !self.shape.is_convex() {
            let hint = match self.shape {
                Shape::Mesh(_) => "a mesh that is not convex; ask for its hull or for convex pieces",
                _ => "a half-space",
            };
            return Err(Error::Invalid(format!("is attached to '{link}' and {hint}")));
        }
        Ok(())
    }

    /// What messages call it: its name, or its number and its type.
    pub fn label(&self, index: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("{index} ({})", self.shape.as_str()))
    }

    /// Where it is at time `t`, s.
    #[must_use]
    pub fn at(&self, t: f64) -> Self {
        Self { shape: self.shape.moved(&(self.velocity * t)), ..self.clone() }
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

impl From<Cylinder> for Shape {
    fn from(cylinder: Cylinder) -> Self {
        Self::Cylinder(cylinder)
    }
}

impl From<HalfSpace> for Shape {
    fn from(half_space: HalfSpace) -> Self {
        Self::HalfSpace(half_space)
    }
}

impl From<Mesh> for Shape {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(mesh)
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
