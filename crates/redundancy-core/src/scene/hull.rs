//! The convex hull of points, for support queries.
//!
//! Quickhull [Barber1996] on integer coordinates: points are rounded to a grid of 2^-40 of their extent, on which the sign
//! of a determinant is exact in 128 bits. So the hull is a closed surface whatever the input: flat parts, needles and repeated
//! points need no tolerance, and nothing can fail or loop. The vertices that are returned are the given ones, so the hull
//! is off by at most that rounding, some 1e-12 of the extent.
//!
//! The furthest vertex in a direction is found by climbing over the edges from a vertex that was found before, or from the
//! best of a few directions that were looked up at the start.

use std::collections::HashMap;

use nalgebra::Vector3;

/// Grid cells along the extent.
const GRID_BITS: i32 = 40;
/// Points for which every vertex is checked: climbing costs as much.
const FEW: usize = 12;
/// Directions of the table: a cube's faces in cells.
const CELLS: usize = 4;

/// Vertices of a convex polyhedron and their neighbours.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hull {
    points: Vec<[f64; 3]>,
    /// Neighbours of vertex i are `neighbours[first[i]..first[i + 1]]`.
    first: Vec<u32>,
    neighbours: Vec<u32>,
    /// For each direction of the table the vertex that is furthest in it.
    start: Vec<u32>,
    /// Their mean.
    middle: Vector3<f64>,
}

impl Hull {
    /// Of finite points; `None` without any.
    pub fn new(points: &[[f64; 3]]) -> Option<Self> {
        let (grid, original) = on_grid(points)?;
        let builder = Builder { grid: &grid, faces: Vec::new() };
        let edges = builder.edges();
        let mut used: Vec<u32> = edges.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        if used.is_empty() {
            used.push(0);
        }
        let place: HashMap<u32, u32> = used.iter().enumerate().map(|(new, old)| (*old, new as u32)).collect();
        let mut lists = vec![Vec::new(); used.len()];
        for [a, b] in edges {
            let (a, b) = (place[&a], place[&b]);
            lists[a as usize].push(b);
            lists[b as usize].push(a);
        }
        let mut hull = Self {
            points: used.iter().map(|i| points[original[*i as usize]]).collect(),
            first: vec![0],
            neighbours: Vec::new(),
            start: Vec::new(),
            middle: Vector3::zeros(),
        };
        let sum: Vector3<f64> = hull.points.iter().map(|p| Vector3::from(*p)).sum();
        hull.middle = sum / hull.points.len() as f64;
        for list in &mut lists {
            list.sort_unstable();
            list.dedup();
            hull.neighbours.extend(list.iter());
            hull.first.push(hull.neighbours.len() as u32);
        }
        hull.start =
            (0..6 * CELLS * CELLS).map(|cell| hull.furthest_of_all(&direction(cell)) as u32).collect();
        Some(hull)
    }

    /// The vertices.
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// A point inside.
    pub fn middle(&self) -> Vector3<f64> {
        self.middle
    }

    fn furthest_of_all(&self, d: &[f64; 3]) -> usize {
        let mut best = (0, f64::NEG_INFINITY);
        for (i, p) in self.points.iter().enumerate() {
            let x = dot(p, d);
            if x > best.1 {
                best = (i, x);
            }
        }
        best.0
    }

    /// A vertex to begin with in the direction `d`.
    #[inline]
    pub fn start(&self, d: &[f64; 3]) -> u32 {
        self.start[cell(d)]
    }

    /// The vertex that is furthest in the direction `d`, looked for from `from` on.
    #[inline]
    pub fn furthest(&self, d: &[f64; 3], from: u32) -> u32 {
        if self.points.len() <= FEW {
            return self.furthest_of_all(d) as u32;
        }
        let mut at = from as usize;
        let mut best = dot(&self.points[at], d);
        loop {
            let mut next = at;
            for &j in &self.neighbours[self.first[at] as usize..self.first[at + 1] as usize] {
                let x = dot(&self.points[j as usize], d);
                if x > best {
                    (best, next) = (x, j as usize);
                }
            }
            if next == at {
                return at as u32;
            }
            at = next;
        }
    }
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The cell of the table that a direction is in.
#[inline(always)]
fn cell(d: &[f64; 3]) -> usize {
    let size = d.map(f64::abs);
    let axis = if size[0] >= size[1] && size[0] >= size[2] {
        0
    } else if size[1] >= size[2] {
        1
    } else {
        2
    };
    let scale = 0.5 * CELLS as f64 / size[axis].max(f64::MIN_POSITIVE);
    let place = |x: f64| ((x * scale + 0.5 * CELLS as f64) as usize).min(CELLS - 1);
    let side = usize::from(d[axis] < 0.0);
    ((2 * axis + side) * CELLS + place(d[(axis + 1) % 3])) * CELLS + place(d[(axis + 2) % 3])
}

/// The middle of a cell of the table.
fn direction(cell: usize) -> [f64; 3] {
    let (face, u, v) = (cell / (CELLS * CELLS), cell / CELLS % CELLS, cell % CELLS);
    let middle = |i: usize| 2.0 * (i as f64 + 0.5) / CELLS as f64 - 1.0;
    let mut d = [0.0; 3];
    let axis = face / 2;
    d[axis] = if face % 2 == 0 { 1.0 } else { -1.0 };
    d[(axis + 1) % 3] = middle(u);
    d[(axis + 2) % 3] = middle(v);
    d
}

type Cell = [i64; 3];

/// Different grid cells and for each the number of a point in it.
fn on_grid(points: &[[f64; 3]]) -> Option<(Vec<Cell>, Vec<usize>)> {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for p in points {
        (low, high) = (low.inf(&Vector3::from(*p)), high.sup(&Vector3::from(*p)));
    }
    let extent = (high - low).amax();
    if points.is_empty() || !extent.is_finite() {
        return None;
    }
    let scale = if extent > 0.0 { f64::from(GRID_BITS).exp2() / extent } else { 0.0 };
    let mut known = HashMap::with_capacity(points.len());
    let (mut grid, mut original) = (Vec::new(), Vec::new());
    for (i, p) in points.iter().enumerate() {
        // A scale that overflows is that of an extent near the smallest number: all points are one.
        let cell: Cell = std::array::from_fn(|k| ((p[k] - low[k]) * scale).round() as i64);
        known.entry(cell).or_insert_with(|| {
            grid.push(cell);
            original.push(i);
        });
    }
    Some((grid, original))
}

fn minus(a: Cell, b: Cell) -> [i128; 3] {
    std::array::from_fn(|i| i128::from(a[i] - b[i]))
}

fn cross(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn product(a: [i128; 3], b: [i128; 3]) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Length that orders exact vectors well enough.
fn size(v: [i128; 3]) -> f64 {
    v.iter().map(|x| (*x as f64).powi(2)).sum()
}

struct Face {
    corners: [u32; 3],
    /// Across the edge from corner i to corner i + 1.
    beside: [u32; 3],
    normal: [i128; 3],
    /// Points outside of it that no other face has, and the furthest of them.
    outside: Vec<u32>,
    furthest: (i128, u32),
    alive: bool,
}

struct Builder<'a> {
    grid: &'a [Cell],
    faces: Vec<Face>,
}

impl Builder<'_> {
    /// The edges of the hull, each at least once.
    fn edges(mut self) -> Vec<[u32; 2]> {
        let Some([a, b]) = self.ends() else { return Vec::new() };
        let Some(c) = self.off_line(a, b) else { return vec![[a, b]] };
        let normal = cross(self.between(a, b), self.between(a, c));
        let Some(d) = self.off_plane(a, normal) else { return self.flat(normal) };
        self.simplex(if product(normal, self.between(a, d)) > 0 { [a, c, b, d] } else { [a, b, c, d] });
        let mut open: Vec<u32> = (0..4).collect();
        while let Some(face) = open.pop() {
            let here = &self.faces[face as usize];
            if here.alive && !here.outside.is_empty() {
                let apex = here.furthest.1;
                self.add(face, apex, &mut open);
            }
        }
        let alive = self.faces.iter().filter(|face| face.alive);
        alive
            .flat_map(|f| [0, 1, 2].map(|i| [f.corners[i], f.corners[(i + 1) % 3]]))
            .filter(|e| e[0] < e[1])
            .collect()
    }

    fn between(&self, a: u32, b: u32) -> [i128; 3] {
        minus(self.grid[b as usize], self.grid[a as usize])
    }

    /// Two points that are far apart; `None` where there is one.
    fn ends(&self) -> Option<[u32; 2]> {
        let axis = (0..3).max_by_key(|i| {
            let along = self.grid.iter().map(|p| p[*i]);
            along.clone().max().unwrap_or(0) - along.min().unwrap_or(0)
        })?;
        let key = |i: &u32| self.grid[*i as usize][axis];
        let all = 0..self.grid.len() as u32;
        let (a, b) = (all.clone().min_by_key(key)?, all.max_by_key(key)?);
        (a != b).then_some([a, b])
    }

    fn off_line(&self, a: u32, b: u32) -> Option<u32> {
        let along = self.between(a, b);
        let off = |i: &u32| size(cross(along, self.between(a, *i)));
        let c = (0..self.grid.len() as u32).max_by(|i, j| off(i).total_cmp(&off(j)))?;
        // A square of integers is 0 only where all are.
        (off(&c) > 0.0).then_some(c)
    }

    fn off_plane(&self, a: u32, normal: [i128; 3]) -> Option<u32> {
        let off = |i: &u32| product(normal, self.between(a, *i)).abs();
        let d = (0..self.grid.len() as u32).max_by_key(off)?;
        (off(&d) > 0).then_some(d)
    }

    /// The outline of points in a plane, by Andrew's monotone chain.
    fn flat(&self, normal: [i128; 3]) -> Vec<[u32; 2]> {
        let drop = (0..3).max_by_key(|i| normal[*i].abs()).unwrap_or(0);
        let (u, v) = ((drop + 1) % 3, (drop + 2) % 3);
        let mut order: Vec<u32> = (0..self.grid.len() as u32).collect();
        order.sort_by_key(|i| (self.grid[*i as usize][u], self.grid[*i as usize][v]));
        let turn = |a: u32, b: u32, c: u32| {
            let (p, q) = (self.between(a, b), self.between(a, c));
            p[u] * q[v] - p[v] * q[u]
        };
        let mut ring: Vec<u32> = Vec::new();
        for half in 0..2 {
            let begin = ring.len();
            for i in &order {
                while ring.len() >= begin + 2 && turn(ring[ring.len() - 2], ring[ring.len() - 1], *i) <= 0 {
                    ring.pop();
                }
                ring.push(*i);
            }
            ring.pop();
            if half == 0 {
                order.reverse();
            }
        }
        (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]).collect()
    }

    /// The first tetrahedron; d is below the face a, b, c.
    fn simplex(&mut self, [a, b, c, d]: [u32; 4]) {
        for (corners, beside) in
            [([a, b, c], [3, 1, 2]), ([c, b, d], [0, 3, 2]), ([a, c, d], [0, 1, 3]), ([b, a, d], [0, 2, 1])]
        {
            self.push(corners, beside);
        }
        let all: Vec<u32> = (0..self.grid.len() as u32).collect();
        self.share(&all, 0);
    }

    fn push(&mut self, corners: [u32; 3], beside: [u32; 3]) {
        let normal = cross(self.between(corners[0], corners[1]), self.between(corners[0], corners[2]));
        let face = Face { corners, beside, normal, outside: Vec::new(), furthest: (0, 0), alive: true };
        self.faces.push(face);
    }

    /// How far outside of a face a point is, in a unit of its own.
    fn height(&self, face: &Face, point: u32) -> i128 {
        product(face.normal, self.between(face.corners[0], point))
    }

    /// Gives each point to the first of the faces from `from` on that it is outside of.
    fn share(&mut self, points: &[u32], from: usize) {
        for &point in points {
            for i in from..self.faces.len() {
                let height = self.height(&self.faces[i], point);
                if height > 0 {
                    let face = &mut self.faces[i];
                    face.outside.push(point);
                    if height > face.furthest.0 {
                        face.furthest = (height, point);
                    }
                    break;
                }
            }
        }
    }

    /// Replaces what `apex` sees, `face` among it, by a cone from it.
    fn add(&mut self, face: u32, apex: u32, open: &mut Vec<u32>) {
        let mut seen = vec![face];
        self.faces[face as usize].alive = false;
        // Edges between what is seen and what is not: from, to, and the face that stays.
        let mut horizon: Vec<(u32, u32, u32)> = Vec::new();
        let mut next = 0;
        while let Some(&at) = seen.get(next) {
            next += 1;
            for i in 0..3 {
                let (corners, other) = (self.faces[at as usize].corners, self.faces[at as usize].beside[i]);
                let beside = &self.faces[other as usize];
                if !beside.alive {
                    continue;
                }
                if self.height(beside, apex) > 0 {
                    self.faces[other as usize].alive = false;
                    seen.push(other);
                } else {
                    horizon.push((corners[i], corners[(i + 1) % 3], other));
                }
            }
        }
        // An edge may have been noted before the face behind it was seen.
        horizon.retain(|(.., stays)| self.faces[*stays as usize].alive);
        let begin = self.faces.len() as u32;
        let starts: HashMap<u32, u32> =
            horizon.iter().enumerate().map(|(i, (from, ..))| (*from, begin + i as u32)).collect();
        let ends: HashMap<u32, u32> =
            horizon.iter().enumerate().map(|(i, (_, to, _))| (*to, begin + i as u32)).collect();
        for (i, (from, to, stays)) in horizon.iter().enumerate() {
            let new = begin + i as u32;
            // The horizon is one closed loop.
            let (after, before) =
                (starts.get(to).copied().unwrap_or(new), ends.get(from).copied().unwrap_or(new));
            self.push([*from, *to, apex], [*stays, after, before]);
            let neighbour = &mut self.faces[*stays as usize];
            for k in 0..3 {
                if neighbour.corners[k] == *to && neighbour.corners[(k + 1) % 3] == *from {
                    neighbour.beside[k] = new;
                }
            }
        }
        let mut points: Vec<u32> = Vec::new();
        for at in seen {
            points.append(&mut self.faces[at as usize].outside);
        }
        points.retain(|point| *point != apex);
        self.share(&points, begin as usize);
        open.extend(begin..self.faces.len() as u32);
    }
}
