//! Paths with an analytic curve: circle and raster.

use nalgebra::{Complex, Unit, Vector3};

use crate::error::{Error, Result, check_finite};
use crate::pose::Pose;
use crate::tolerance::{CORNER_FIT, DIRECTION_NORM, UNIT_AXIS};

/// A circle, an arc or several turns.
///
/// The point at angle `phi` is `center + radius (cos phi e1 + sin phi e2)`. `(e1, e2)` is `(x, y)` carried by the
/// shortest rotation from `z` to `normal` (about `x` for `normal = -z`), so that positive turns are counter-clockwise
/// seen from the tip of the normal.
///
/// ```
/// use redundancy_core::{nalgebra::Vector3, path::Circle};
/// let circle = Circle::new(Vector3::new(0.5, 0.0, 0.4), 0.1, 0.0, 1.0, Vector3::z())?;
/// let path = circle.path(100)?;
/// assert!((path.length() - 0.2 * std::f64::consts::PI).abs() < 1e-15);
/// let point = path.at(0.25 * path.length())?;
/// assert!((point.pose.translation.vector - Vector3::new(0.5, 0.1, 0.4)).norm() < 1e-15);
/// assert!((point.second_derivative.fixed_rows::<3>(0).norm() - 10.0).abs() < 1e-12); // curvature 1 / radius
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Circle {
    center: Vector3<f64>,
    radius: f64,
    start: f64,
    turns: f64,
    normal: Unit<Vector3<f64>>,
}

impl Circle {
    /// Centre and radius in metres, start angle in radians, turns (negative: clockwise), normal of the plane.
    ///
    /// # Errors
    /// Numbers that are not finite, `radius <= 0`, `turns = 0`, a normal without length.
    pub fn new(
        center: Vector3<f64>,
        radius: f64,
        start: f64,
        turns: f64,
        normal: Vector3<f64>,
    ) -> Result<Self> {
        check_finite("center", center.as_slice())?;
        check_finite("start", &[start])?;
        check_positive("radius", radius)?;
        check_finite("turns", &[turns])?;
        if turns == 0.0 {
            return Err(out_of_range("turns", turns, "other than 0"));
        }
        Ok(Self { center, radius, start, turns, normal: direction("normal", normal)? })
    }

    /// Arc length, m.
    pub fn length(&self) -> f64 {
        std::f64::consts::TAU * self.radius * self.turns.abs()
    }

    /// Position and its first two derivatives with respect to arc length.
    pub fn at(&self, s: f64) -> [Vector3<f64>; 3] {
        let (e1, e2) = self.axes();
        let sense = self.turns.signum();
        let (sin, cos) = (self.start + sense * s / self.radius).sin_cos();
        let radial = e1 * cos + e2 * sin;
        let tangent = (e2 * cos - e1 * sin) * sense;
        [self.center + radial * self.radius, tangent, -radial / self.radius]
    }

    /// Shortest rotation from z to the normal applied to x and y.
    fn axes(&self) -> (Vector3<f64>, Vector3<f64>) {
        let n = self.normal;
        if n.z > 0.0 || n.x != 0.0 || n.y != 0.0 {
            // 1 + n_z without cancellation for n near -z.
            let k = if n.z >= 0.0 { 1.0 + n.z } else { (n.x * n.x + n.y * n.y) / (1.0 - n.z) };
            (
                Vector3::new(1.0 - n.x * n.x / k, -n.x * n.y / k, -n.x),
                Vector3::new(-n.x * n.y / k, 1.0 - n.y * n.y / k, -n.y),
            )
        } else {
            (Vector3::x(), -Vector3::y())
        }
    }

    /// The circle moved by a rigid transform; its points stay at their arc lengths.
    pub(super) fn transformed(&self, by: &Pose) -> Self {
        let mut moved = Self {
            center: by.rotation * self.center + by.translation.vector,
            normal: Unit::new_normalize(by.rotation * self.normal.into_inner()),
            ..self.clone()
        };
        // The new axes are those that belong to the new normal: the start angle takes up their turn about it.
        let (zero, (e1, e2)) = (by.rotation * self.axes().0, moved.axes());
        moved.start += zero.dot(&e2).atan2(zero.dot(&e1));
        moved
    }

    /// The circle from its end to its start.
    pub(super) fn reversed(&self) -> Self {
        let start = self.start + std::f64::consts::TAU * self.turns;
        Self { start, turns: -self.turns, ..self.clone() }
    }

    /// Centre, m.
    pub fn center(&self) -> Vector3<f64> {
        self.center
    }

    /// Radius, m.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Angle of the first point, rad.
    pub fn start(&self) -> f64 {
        self.start
    }

    /// Turns, negative for clockwise.
    pub fn turns(&self) -> f64 {
        self.turns
    }

    /// Normal of the plane.
    pub fn normal(&self) -> Unit<Vector3<f64>> {
        self.normal
    }
}

/// Parallel strokes, there and back, joined by U-turns that lie inside the strokes' ends.
///
/// A U-turn is two corners of 90 degrees and arc length `Lc` with curvature `pi/(2 Lc) (1 - cos(2 pi u / Lc))`, `u`
/// running from 0 to `Lc`, and a straight between them. Heading and curvature are continuous, so is the curvature's
/// slope. A corner needs `c = Lc integral_0^1 cos(theta)` of both sides, `theta(v) = pi/2 (v - sin(2 pi v)/(2 pi))`,
/// that is `c = 0.58440898690 Lc`; the straight between is `spacing - 2 c`. Without `corner` the strokes meet the
/// straights at right angles, and every straight is sampled by itself, so that the corners are samples.
///
/// ```
/// use redundancy_core::{nalgebra::Vector3, path::Raster};
/// let origin = Vector3::new(0.35, -0.25, -0.3);
/// let raster = Raster::new(origin, 0.5, 0.2, 3, Some(0.16752193), Vector3::y(), Vector3::x())?;
/// let path = raster.path(0.002)?;
/// assert_eq!(path.len(), 894);
/// assert!((path.length() - 1.786877149).abs() < 1e-9);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    origin: Vector3<f64>,
    length: f64,
    spacing: f64,
    strokes: usize,
    corner: Option<f64>,
    along: Unit<Vector3<f64>>,
    across: Unit<Vector3<f64>>,
    pieces: Vec<Piece>,
}

/// A straight or a corner: where it starts, how it heads. Headings are complex numbers: real along, imaginary across.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    start: f64,
    length: f64,
    position: Complex<f64>,
    heading: Complex<f64>,
    /// 0 for a straight, +1 for a left corner (from along to across), -1 for a right one.
    turn: f64,
}

impl Raster {
    /// `origin` is the start of the first stroke, which runs `length` metres to `along`; the next one lies `spacing`
    /// metres to `across`. `corner` is the arc length `Lc` of a corner, `None` for sharp ones.
    ///
    /// # Errors
    /// Numbers that are not finite or not positive, `strokes = 0`, more than a million strokes, `across` not at a right
    /// angle to `along`, corners that do not fit between the strokes or into them.
    pub fn new(
        origin: Vector3<f64>,
        length: f64,
        spacing: f64,
        strokes: usize,
        corner: Option<f64>,
        along: Vector3<f64>,
        across: Vector3<f64>,
    ) -> Result<Self> {
        check_finite("origin", origin.as_slice())?;
        check_positive("length", length)?;
        check_positive("spacing", spacing)?;
        if strokes == 0 || strokes > MOST_STROKES {
            return Err(out_of_range("strokes", strokes as f64, "from 1 to 1000000"));
        }
        let (along, across) = (direction("along", along)?, direction("across", across)?);
        let cosine = along.dot(&across);
        if cosine.abs() > CORNER_FIT {
            let what = "along . across (cosine of the angle between stroke and shift)";
            return Err(out_of_range(what, cosine, "0: a right angle"));
        }
        if let Some(corner) = corner {
            check_positive("corner", corner)?;
            let side = corner * corner_at(1.0).re;
            let fits = |what: &str, room: f64| match side <= room * (1.0 + CORNER_FIT) {
                true => Ok(()),
                false => Err(out_of_range(
                    "corner",
                    corner,
                    &format!("at most {}, so that it fits into {what}", room / corner_at(1.0).re),
                )),
            };
            if strokes > 1 {
                fits("half the spacing", 0.5 * spacing)?;
                fits("the strokes", if strokes > 2 { 0.5 * length } else { length })?;
            }
        }
        let mut raster = Self { origin, length, spacing, strokes, corner, along, across, pieces: Vec::new() };
        raster.pieces = raster.layout();
        Ok(raster)
    }

    fn layout(&self) -> Vec<Piece> {
        let side = self.corner.map_or(0.0, |corner| corner * corner_at(1.0).re);
        let mut pieces: Vec<Piece> = Vec::with_capacity(4 * self.strokes);
        let mut end = (0.0, Complex::new(0.0, 0.0), Complex::new(1.0, 0.0));
        let mut push = |length: f64, turn: f64| {
            let (start, position, heading) = end;
            let piece = Piece { start, length, position, heading, turn };
            let after = if turn == 0.0 { heading } else { heading * Complex::new(0.0, turn) };
            end = (start + length, piece.at(length)[0], after);
            // Corners may take the whole straight; rounding must not leave one behind.
            if length > CORNER_FIT * self.length {
                pieces.push(piece);
            }
        };
        for stroke in 0..self.strokes {
            let (first, last) = (stroke == 0, stroke + 1 == self.strokes);
            let corners = f64::from(u8::from(!first)) + f64::from(u8::from(!last));
            push((self.length - corners * side).max(0.0), 0.0);
            if last {
                break;
            }
            let turn = if stroke % 2 == 0 { 1.0 } else { -1.0 };
            push(self.corner.unwrap_or(0.0), turn);
            push((self.spacing - 2.0 * side).max(0.0), 0.0);
            push(self.corner.unwrap_or(0.0), turn);
        }
        pieces
    }

    /// Arc length of strokes and turns, m.
    pub fn arc_length(&self) -> f64 {
        self.pieces.last().map_or(0.0, |piece| piece.start + piece.length)
    }

    /// Position and its first two derivatives with respect to arc length; at a sharp corner those of what follows.
    pub fn at(&self, s: f64) -> [Vector3<f64>; 3] {
        let i = self.pieces.partition_point(|piece| piece.start <= s).clamp(1, self.pieces.len()) - 1;
        let piece = &self.pieces[i];
        let [p, d, dd] = piece.at((s - piece.start).clamp(0.0, piece.length));
        let lift = |z: Complex<f64>| *self.along * z.re + *self.across * z.im;
        [self.origin + lift(p), lift(d), lift(dd)]
    }

    /// The raster moved by a rigid transform.
    pub(super) fn transformed(&self, by: &Pose) -> Self {
        let turned = |v: &Unit<Vector3<f64>>| Unit::new_normalize(by.rotation * v.into_inner());
        Self {
            origin: by.rotation * self.origin + by.translation.vector,
            along: turned(&self.along),
            across: turned(&self.across),
            ..self.clone()
        }
    }

    /// The raster from its end to its start: again a raster, since a corner is its own mirror image.
    pub(super) fn reversed(&self) -> Self {
        let along = if self.strokes.is_multiple_of(2) { self.along } else { -self.along };
        let [origin, ..] = self.at(self.arc_length());
        Self { origin, along, across: -self.across, ..self.clone() }
    }

    /// Arc lengths about `step` metres apart: the length divided evenly, and with sharp corners every straight by itself.
    ///
    /// # Errors
    /// A step that is not positive, or so small that there would be more than ten million samples.
    pub(super) fn samples(&self, step: f64) -> Result<Vec<f64>> {
        check_positive("step", step)?;
        check_samples("step", step, self.arc_length())?;
        if self.corner.is_some() {
            return Ok(even(self.arc_length(), intervals(self.arc_length(), step)));
        }
        let mut s = vec![0.0];
        for piece in &self.pieces {
            let n = intervals(piece.length, step);
            s.extend(even(piece.length, n).iter().skip(1).map(|u| piece.start + u));
        }
        Ok(s)
    }

    /// Start of the first stroke, m.
    pub fn origin(&self) -> Vector3<f64> {
        self.origin
    }

    /// Length of a stroke with its corners, m.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Distance of neighbouring strokes, m.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Number of strokes.
    pub fn strokes(&self) -> usize {
        self.strokes
    }

    /// Arc length of a corner, m; `None` for sharp corners.
    pub fn corner(&self) -> Option<f64> {
        self.corner
    }

    /// Direction of the first stroke.
    pub fn along(&self) -> Unit<Vector3<f64>> {
        self.along
    }

    /// Direction from one stroke to the next.
    pub fn across(&self) -> Unit<Vector3<f64>> {
        self.across
    }
}

/// Above this a raster is a typing error, not a job.
const MOST_STROKES: usize = 1_000_000;

impl Piece {
    /// Position and derivatives after `u` metres.
    fn at(&self, u: f64) -> [Complex<f64>; 3] {
        if self.turn == 0.0 || self.length == 0.0 {
            return [self.position + self.heading * u, self.heading, Complex::new(0.0, 0.0)];
        }
        let v = u / self.length;
        // A right corner is a left one mirrored about the heading.
        let mirrored = |z: Complex<f64>| if self.turn > 0.0 { z } else { z.conj() };
        let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
        let theta = heading_after(v, sin);
        let direction = Complex::new(theta.cos(), theta.sin());
        let curvature = std::f64::consts::FRAC_PI_2 / self.length * (1.0 - cos);
        [
            self.position + self.heading * mirrored(corner_at(v)) * self.length,
            self.heading * mirrored(direction),
            self.heading * mirrored(direction * Complex::new(0.0, curvature)),
        ]
    }
}

/// `theta(v) = pi/2 (v - sin(2 pi v) / (2 pi))`.
fn heading_after(v: f64, sin: f64) -> f64 {
    std::f64::consts::FRAC_PI_2 * (v - sin / std::f64::consts::TAU)
}

/// `integral_0^v exp(i theta)` of a corner of length 1: four panels of the ten-point Gauss rule, exact to rounding.
fn corner_at(v: f64) -> Complex<f64> {
    const NODES: [(f64, f64); 5] = [
        (0.148_874_338_981_631_22, 0.295_524_224_714_752_87),
        (0.433_395_394_129_247_2, 0.269_266_719_309_996_35),
        (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
        (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
        (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
    ];
    const PANELS: i32 = 4;
    let half = 0.5 * v / f64::from(PANELS);
    let value = |x: f64| {
        let theta = heading_after(x, (std::f64::consts::TAU * x).sin());
        Complex::new(theta.cos(), theta.sin())
    };
    let mut sum = Complex::new(0.0, 0.0);
    for panel in 0..PANELS {
        let middle = half * f64::from(2 * panel + 1);
        for (node, weight) in NODES {
            sum += (value(middle - half * node) + value(middle + half * node)) * weight;
        }
    }
    sum * half
}

/// `n + 1` numbers from 0 to `length`; the last one is exact.
pub(super) fn even(length: f64, n: usize) -> Vec<f64> {
    (0..=n).map(|i| if i == n { length } else { length * (i as f64) / (n as f64) }).collect()
}

/// Number of intervals of about `step`.
pub(super) fn intervals(length: f64, step: f64) -> usize {
    (length / step).round().max(1.0) as usize
}

/// Refuses steps that would give more than ten million samples.
pub(super) fn check_samples(what: &str, step: f64, length: f64) -> Result<()> {
    if length / step > 1e7 {
        let bound = format!("at least {:e}: ten million samples over {length} m", length / 1e7);
        return Err(out_of_range(what, step, &bound));
    }
    Ok(())
}

fn check_positive(what: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(out_of_range(what, value, "finite and > 0")) }
}

pub(super) fn out_of_range(what: &str, value: f64, bound: &str) -> Error {
    Error::OutOfRange { what: what.into(), value, bound: bound.into() }
}

fn direction(what: &str, v: Vector3<f64>) -> Result<Unit<Vector3<f64>>> {
    check_finite(what, v.as_slice())?;
    // What is a unit vector already keeps its bits.
    if (v.norm() - 1.0).abs() <= UNIT_AXIS {
        return Ok(Unit::new_unchecked(v));
    }
    let too_short = Error::ZeroDirection { what: what.into(), norm: v.norm(), minimum: DIRECTION_NORM };
    Unit::try_new(v, DIRECTION_NORM).ok_or(too_short)
}
