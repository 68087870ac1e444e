//! Signed distance of a segment from any shape.

use nalgebra::Vector3;

use super::convex::Memory;
use super::core_shape::Core;
use super::distance::{Nearest, to_box, to_capsule, to_sphere};
use super::narrow::{Placement, gap};
use super::obstacle::{Capsule, Cuboid, Shape, Sphere};
use super::proximity::with_memory;
use super::scene::Scene;
use super::solid::{Form, Solid};
use crate::pose::pose;

/// Signed distance of the segment from `start` to `end` from a shape: closed forms for spheres, boxes and capsules.
pub fn segment_distance(start: &Vector3<f64>, end: &Vector3<f64>, shape: &Shape) -> Nearest {
    match shape {
        Shape::Sphere(sphere) => to_sphere(start, end, sphere),
        Shape::Capsule(capsule) => to_capsule(start, end, capsule),
        Shape::Box(cuboid) => to_box(start, end, cuboid),
        _ => to_solids(start, end, &shape.solids(), &Vector3::zeros(), &mut Memory::new()),
    }
}

/// The nearest of several solids, all shifted.
pub(crate) fn to_solids(
    start: &Vector3<f64>,
    end: &Vector3<f64>,
    solids: &[Solid],
    shift: &Vector3<f64>,
    memory: &mut Memory,
) -> Nearest {
    let segment = Solid::capsule(start, end, 0.0);
    let (world, place) = (Placement::world(), Placement { origin: *shift, ..Placement::world() });
    let mut best: Option<Nearest> = None;
    memory.contact_only = false;
    for solid in solids {
        let upto = best.as_ref().map_or(f64::INFINITY, |best| best.distance);
        let Some(gap) = gap((&segment, &world), (solid, &place), upto, memory) else { continue };
        if gap.distance < upto {
            let along = end - start;
            let square = along.norm_squared();
            let share = if square > 0.0 { (gap.at - start).dot(&along) / square } else { 0.0 };
            best = Some(Nearest {
                distance: gap.distance,
                share: share.clamp(0.0, 1.0),
                point: gap.at,
                normal: gap.normal,
                gradient: gap.gradient,
            });
        }
    }
    let none = || Nearest {
        distance: f64::INFINITY,
        share: 0.0,
        point: *start,
        normal: Vector3::z(),
        gradient: Vector3::z(),
    };
    best.unwrap_or_else(none)
}

/// The obstacles of a scene beside segments that are queried many times.
#[derive(Debug, Clone)]
pub(crate) struct SegmentObstacles {
    /// Shapes and their velocities.
    solids: Vec<(Solid, Vector3<f64>)>,
}

impl SegmentObstacles {
    /// Of a scene whose obstacles all stand in the world.
    pub fn new(scene: &Scene) -> Self {
        let each = scene.obstacles().iter().zip(scene.solids());
        let solids = each.flat_map(|(o, solids)| solids.iter().map(move |solid| (solid.clone(), o.velocity)));
        Self { solids: solids.collect() }
    }

    /// Those that come within `reach` of a point at time `t`.
    pub fn within(&self, from: &Vector3<f64>, reach: f64, t: f64) -> Vec<u32> {
        let near = |(solid, velocity): &(Solid, Vector3<f64>)| {
            (solid.ball.0 + velocity * t - from).norm() <= reach + solid.ball.1
        };
        (0..self.solids.len() as u32).filter(|i| near(&self.solids[*i as usize])).collect()
    }

    /// The least distance from those in a list, at most `far`.
    #[inline]
    pub fn least(&self, start: &Vector3<f64>, end: &Vector3<f64>, t: f64, list: &[u32], far: f64) -> f64 {
        list.iter().fold(far, |least, i| {
            let (solid, velocity) = &self.solids[*i as usize];
            least.min(to_solid(start, end, solid, &(velocity * t)).distance)
        })
    }

    /// The nearest one, with its velocity, below `upto`.
    pub fn nearest(
        &self,
        start: &Vector3<f64>,
        end: &Vector3<f64>,
        t: f64,
        upto: f64,
    ) -> Option<(Nearest, Vector3<f64>)> {
        let (middle, half) = (0.5 * (start + end), 0.5 * (end - start).norm());
        let mut best: Option<(Nearest, Vector3<f64>)> = None;
        for (solid, velocity) in &self.solids {
            let upto = best.as_ref().map_or(upto, |best| best.0.distance);
            let (shift, far) = (velocity * t, upto + solid.ball.1 + half);
            if half == 0.0 || far > 0.0 && (middle - solid.ball.0 - shift).norm_squared() > far * far {
                continue;
            }
            let near = to_solid(start, end, solid, &shift);
            if near.distance < upto {
                best = Some((near, *velocity));
            }
        }
        best
    }
}

/// Whether the distance of a segment from a solid has a closed form.
#[inline(always)]
pub(super) fn has_closed_form(solid: &Solid) -> bool {
    match &solid.form {
        Form::Convex(Core::Point | Core::Segment(_)) => true,
        Form::Convex(Core::Box(_)) => solid.radius == 0.0,
        _ => false,
    }
}

/// Distance of a segment from a solid that is shifted.
#[inline(always)]
pub(super) fn to_solid(
    start: &Vector3<f64>,
    end: &Vector3<f64>,
    solid: &Solid,
    shift: &Vector3<f64>,
) -> Nearest {
    let origin = solid.origin + shift;
    match &solid.form {
        Form::Convex(Core::Point) => to_sphere(start, end, &Sphere { center: origin, radius: solid.radius }),
        Form::Convex(Core::Segment(_)) => {
            let capsule =
                Capsule { start: solid.rod.start + shift, end: solid.rod.end + shift, radius: solid.radius };
            to_capsule(start, end, &capsule)
        }
        Form::Convex(Core::Box(half)) if solid.radius == 0.0 => {
            to_box(start, end, &Cuboid { pose: pose(solid.rotation, origin), half_extents: *half })
        }
        _ => with_memory(|memory| {
            to_solids(start, end, std::slice::from_ref(solid), shift, &mut memory.convex)
        }),
    }
}
