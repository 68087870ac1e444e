//! The distance of a convex shape from the triangles of a mesh that is not convex.
//!
//! A tree of boxes around triangles is searched nearest first, so that few of them are asked. Apart the distance is exact.
//! Where triangles are touched the depth is that of the deepest of them: the shape has to move at least so far, maybe
//! further. A shape that touches no triangle may be inside of a closed mesh: then it has to move at least as far as the
//! nearest triangle.

use nalgebra::{Matrix3, Vector3};

use super::convex::{Answer, Memory, Separation, distance};
use super::core_shape::Core;
use super::mesh::TriangleMesh;
use super::support::Convex;

/// Most triangles of a leaf.
const LEAF: usize = 4;
/// Deepest level: the halves of the tree are alike in number.
const LEVELS: usize = 64;
/// Direction of the ray that tells inside from outside: along nothing that a drawing has.
const RAY: Vector3<f64> = Vector3::new(0.546_918_160_678, 0.612_372_435_696, 0.570_948_273_149);

/// The triangles of a mesh with boxes around them.
#[derive(Debug, PartialEq)]
pub(crate) struct Surface {
    triangles: Vec<[Vector3<f64>; 3]>,
    nodes: Vec<Node>,
    closed: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// The first triangle of a leaf, or the second child; the first child follows its parent.
    at: u32,
    /// Triangles of a leaf; 0 for a node with children.
    count: u32,
}

impl Surface {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let corner = |i: u32| Vector3::from(mesh.vertices()[i as usize]);
        let mut triangles: Vec<[Vector3<f64>; 3]> = mesh.faces().iter().map(|f| f.map(corner)).collect();
        let mut nodes = Vec::with_capacity(2 * triangles.len() / LEAF + 2);
        let count = triangles.len();
        // (range, parent whose second child it is)
        let mut open = vec![(0..count, None)];
        while let Some((range, parent)) = open.pop() {
            let index = nodes.len();
            if let Some(parent) = parent {
                let parent: &mut Node = &mut nodes[parent];
                parent.at = index as u32;
            }
            let part = &mut triangles[range.clone()];
            let (low, high) = bounds(part.iter().flatten());
            let leaf = part.len() <= LEAF;
            let count = if leaf { part.len() as u32 } else { 0 };
            nodes.push(Node { low, high, at: range.start as u32, count });
            if !leaf {
                let axis = (high - low).imax();
                let key = |t: &[Vector3<f64>; 3]| t[0][axis] + t[1][axis] + t[2][axis];
                let half = part.len() / 2;
                part.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)));
                // The first child is taken next, so that it follows its parent.
                open.push((range.start + half..range.end, Some(index)));
                open.push((range.start..range.start + half, None));
            }
        }
        Self { triangles, nodes, closed: mesh.is_closed() }
    }

    /// The corners of the box around all.
    pub fn corners(&self) -> Vec<Vector3<f64>> {
        let Some(root) = self.nodes.first() else { return Vec::new() };
        let corner =
            |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 0 { root.low[k] } else { root.high[k] });
        (0..8).map(corner).collect()
    }

    /// Signed distance of a convex core from the surface, placed by `rotation` and `origin`; the second of the two is the
    /// surface.
    pub fn distance(
        &self,
        core: &Convex<'_>,
        (rotation, origin): (&Matrix3<f64>, &Vector3<f64>),
        upto: f64,
        memory: &mut Memory,
    ) -> Answer {
        // In the coordinates of the mesh.
        let local = Convex {
            core: core.core,
            rotation: rotation.tr_mul(&core.rotation),
            origin: rotation.tr_mul(&(core.origin - origin)),
        };
        let (low, high) = extent(&local);
        let (mut nearest, mut deepest): (Option<Separation>, Option<Separation>) = (None, None);
        let mut least = upto;
        let mut stack = [(0u32, 0.0); LEVELS];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (index, near) = stack[height];
            if near > least.max(0.0) {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count == 0 {
                let children = [index + 1, node.at].map(|child| {
                    let child_node = &self.nodes[child as usize];
                    (child, between((&low, &high), (&child_node.low, &child_node.high)))
                });
                // The nearer one last, so that it is taken first.
                let order = if children[0].1 < children[1].1 { [1, 0] } else { [0, 1] };
                for i in order {
                    if children[i].1 <= least.max(0.0) && height < LEVELS {
                        stack[height] = children[i];
                        height += 1;
                    }
                }
                continue;
            }
            for triangle in &self.triangles[node.at as usize..(node.at + node.count) as usize] {
                let (a, b) = bounds(triangle.iter());
                if between((&low, &high), (&a, &b)) > least.max(0.0) {
                    continue;
                }
                let core = Core::Triangle(*triangle);
                let second = Convex { core: &core, rotation: Matrix3::identity(), origin: Vector3::zeros() };
                let Answer::Found(found) = distance(&local, &second, least.max(0.0), memory) else {
                    continue;
                };
                if found.distance <= 0.0 {
                    least = 0.0;
                    if deepest.as_ref().is_none_or(|d| found.distance < d.distance) {
                        deepest = Some(found);
                    }
                } else if found.distance < least {
                    least = found.distance;
                    nearest = Some(found);
                }
            }
        }
        let back = |s: Separation| Separation {
            distance: s.distance,
            on_first: rotation * s.on_first + origin,
            on_second: rotation * s.on_second + origin,
            normal: rotation * s.normal,
        };
        if let Some(deepest) = deepest {
            return Answer::Found(back(deepest));
        }
        let middle = local.rotation * local.core.middle() + local.origin;
        if self.closed && self.contains(&middle) {
            // The nearest triangle may be beyond what was asked for: inside, it has to be known.
            let nearest = match nearest {
                Some(nearest) => Some(nearest),
                None if upto.is_finite() => {
                    match self.distance(core, (rotation, origin), f64::INFINITY, memory) {
                        // It is inside, so this answer is complete.
                        answer @ Answer::Found(_) => return answer,
                        Answer::Beyond => None,
                    }
                }
                None => None,
            };
            if let Some(s) = nearest {
                return Answer::Found(back(Separation { distance: -s.distance, normal: -s.normal, ..s }));
            }
        }
        match nearest {
            Some(nearest) => Answer::Found(back(nearest)),
            None => Answer::Beyond,
        }
    }

    /// Whether a point is inside of the closed surface: a ray from it crosses an odd number of triangles.
    fn contains(&self, p: &Vector3<f64>) -> bool {
        let mut inside = false;
        let mut stack = [0u32; LEVELS];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let index = stack[height];
            let node = &self.nodes[index as usize];
            if !meets(p, node) {
                continue;
            }
            if node.count == 0 {
                for child in [index + 1, node.at] {
                    if height < LEVELS {
                        stack[height] = child;
                        height += 1;
                    }
                }
                continue;
            }
            let triangles = &self.triangles[node.at as usize..(node.at + node.count) as usize];
            inside ^= triangles.iter().filter(|t| crosses(p, t)).count() % 2 == 1;
        }
        inside
    }
}

fn bounds<'a>(points: impl Iterator<Item = &'a Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    points.fold(start, |(low, high), p| (low.inf(p), high.sup(p)))
}

/// The box around a core.
fn extent(convex: &Convex<'_>) -> (Vector3<f64>, Vector3<f64>) {
    let reach = |axis: usize, sign: f64| {
        let mut d = Vector3::zeros();
        d[axis] = sign;
        let local = convex.rotation.tr_mul(&d);
        let hint = std::cell::Cell::new(convex.core.start(&local));
        (convex.rotation * convex.core.furthest(&local, &hint) + convex.origin)[axis]
    };
    (Vector3::from_fn(|i, _| reach(i, -1.0)), Vector3::from_fn(|i, _| reach(i, 1.0)))
}

/// Distance of two boxes.
fn between(a: (&Vector3<f64>, &Vector3<f64>), b: (&Vector3<f64>, &Vector3<f64>)) -> f64 {
    Vector3::from_fn(|i, _| (b.0[i] - a.1[i]).max(a.0[i] - b.1[i]).max(0.0)).norm()
}

/// Whether the ray from `p` meets the box of a node.
fn meets(p: &Vector3<f64>, node: &Node) -> bool {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for i in 0..3 {
        // All parts of the direction are positive.
        enter = enter.max((node.low[i] - p[i]) / RAY[i]);
        leave = leave.min((node.high[i] - p[i]) / RAY[i]);
    }
    enter <= leave
}

/// Whether the ray from `p` crosses a triangle [Moeller1997].
fn crosses(p: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> bool {
    let (e, f) = (b - a, c - a);
    let h = RAY.cross(&f);
    let determinant = e.dot(&h);
    if determinant == 0.0 {
        return false;
    }
    let s = p - a;
    let u = s.dot(&h) / determinant;
    let q = s.cross(&e);
    let v = RAY.dot(&q) / determinant;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && f.dot(&q) / determinant > 0.0
}
