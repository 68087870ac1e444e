//! Obstacles, the shapes of an arm's links, and the distances between them.
//!
//! [`Scene`] holds obstacles, [`LinkGeometry`] the shapes of the links and the pairs of links that must not touch;
//! [`Surroundings`] puts them together and implements [`Proximity`]: distances and gradients for a configuration, and whether
//! a motion stays clear. Which distances are exact and which conservative is in docs/scene.md.
//!
//! | file | subject |
//! |---|---|
//! | `obstacle`, `mesh_obstacle`, `json` | what an obstacle can be, scene files |
//! | `geometry`, `body`, `pairs` | shapes of links, SRDF, pairs that are found |
//! | `mesh/` | readers for STL, OBJ and DAE |
//! | `distance` | closed forms for capsules |
//! | `hull`, `core_shape`, `support`, `convex`, `surface` | convex shapes and triangles |
//! | `gjk`, `decompose` | what calls parry; `gilbert` is there without the feature `mesh` |
//! | `solid`, `narrow` | rounded shapes, which method for which pair |
//! | `proximity`, `surroundings` | the trait, and what implements it |

pub mod distance;

mod body;
mod clearance;
mod convex;
mod core_shape;
#[cfg(feature = "mesh")]
mod decompose;
#[cfg(not(feature = "mesh"))]
#[path = "decompose_off.rs"]
mod decompose;
mod freedom;
mod geometry;
#[cfg(feature = "io")]
mod geometry_json;
#[cfg(feature = "urdf")]
mod geometry_urdf;
#[cfg(not(feature = "mesh"))]
mod gilbert;
#[cfg(feature = "mesh")]
mod gjk;
mod hull;
#[cfg(feature = "io")]
mod json;
mod mesh;
mod mesh_obstacle;
mod narrow;
mod obstacle;
mod pairs;
mod proximity;
#[allow(clippy::module_inception)]
mod scene;
mod segment;
mod solid;
#[cfg(feature = "urdf")]
mod srdf;
mod support;
mod surface;
mod surroundings;

pub use clearance::{ByLink, NearestPair, PairClearance, SelfClearance};
pub use distance::Nearest;
pub use freedom::split_by_freedom;
pub use geometry::LinkGeometry;
#[cfg(feature = "urdf")]
pub use geometry_urdf::{LinkMeshes, UrdfOptions};
pub use mesh::{TriangleMesh, locate};
pub use mesh_obstacle::{Mesh, MeshSolid};
pub use narrow::Gap;
pub use obstacle::{Capsule, Cuboid, Cylinder, HalfSpace, Obstacle, Shape, Sphere};
pub use pairs::Reason;
pub use proximity::{
    Contact, Nearby, Proof, Proximity, ProximityMemory, SweepHit, SweepMemory, Thing, Visitor, sweep,
};
pub use scene::Scene;
pub use segment::segment_distance;
#[cfg(feature = "urdf")]
pub use srdf::Srdf;
pub use surroundings::Surroundings;

pub(crate) use proximity::with_memory;
pub(crate) use segment::SegmentObstacles;
