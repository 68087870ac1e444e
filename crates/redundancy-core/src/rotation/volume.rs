//! Quaternion volumes: continuous sets of orientations.
//!
//! # Definition
//! A volume is the set `P * Q(phi_1, n_1) * ... * Q(phi_k, n_k) * S` of one or more rotations about fixed axes, each
//! within bounds [FromGravdahl2007, eqs. (6), (7)], reoriented by `P` from the left (the set moves in the reference
//! frame, eq. (12)) and by `S` from the right (another frame is fixed in the body). `q` is in `P * V` iff
//! `conj(P) * q` is in `V`. A **cone** is the set whose body axis stays within a half-angle of a direction, spin free.
//!
//! # Angles and membership
//! For three rotations `n_1 . R n_3` depends on the middle angle only,
//! `A + B cos phi_2 + C sin phi_2` with `A = (n_1.n_2)(n_2.n_3)`, `B = n_1.n_3 - A`, `C = n_1.(n_2 x n_3)`, so there
//! are two branches `phi_2 = atan2(C, B) +- x`. With `theta` the angle from `n_1` to `R n_3`, `a` and `b` the
//! difference and the sum of the angles between consecutive axes,
//! `tan^2(x/2) = sin((theta+a)/2) sin((theta-a)/2) / (sin((b+theta)/2) sin((b-theta)/2))`, which keeps its digits at
//! the gimbal. The outer angles follow from what they rotate. For two rotations `q . Q(phi_1) Q(phi_2)` is a bilinear
//! form of two unit 2-vectors: its singular vectors give the nearest member of the unbounded sequence.
//!
//! The **margin** is the smallest signed angle from a bound over the rotations, the largest over the branches; a range
//! of a full turn has no bounds. At the gimbal, where only the sum (or difference) of the outer angles is determined,
//! the best split counts. Off a set of fewer than three rotations it is minus the angle from the unbounded sequence.
//! For a cone it is the margin of [`Cone`]. Sequences of more than three rotations: the module `long_sequence`.
//!
//! # The visualising quaternion
//! `V = Q_s * Q_z * conj(Q_s) = (cos psi/2, sin(psi/2) z)`: its vector points along the rotated last axis `z`, its
//! length tells the rotation `psi` about it. [FromGravdahl2007, eq. (8)] is circular as printed and eq. (10) is not a
//! product of sets: the same `Q_s` stands on both sides, so the pair (Q, V) is what is kept.
//!
//! # Cost
//! Membership and margin below 1 us, nearest member below 0.1 ms (three rotations, outside); of five rotations margin and
//! nearest member take about a millisecond (development build). References: [FromGravdahl2007], [FromGravdahl2009].

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

use crate::error::{Error, Result, check_finite, check_length};
use crate::rotation::cone::Cone;
use crate::rotation::long_sequence;
use crate::rotation::quaternion::{
    about, angle_between, compose, from_zyz, nearest_sign, rotation_angle, shortest_arc, to_zyz,
    unit_direction,
};
use crate::rotation::sequence::{
    BoundedRotation, SequenceBranch, middle_weight, middle_zero, nearest_angles, one_rotation,
    three_rotations, two_rotations, weighted_middle,
};
use crate::tolerance::{VOLUME_AXES_PARALLEL, VOLUME_NEAR_GIMBAL};

/// A set of orientations: bounded rotations in sequence, or a cone. Intersections and unions: [`OrientationSet`](crate::rotation::OrientationSet).
///
/// ```
/// use redundancy_core::rotation::{QuaternionVolume, from_zyz};
/// use std::f64::consts::PI;
/// let volume = QuaternionVolume::zyz([-PI, PI], [0.0, 0.3], [-0.5, 0.5])?;
/// assert!(volume.contains(&from_zyz([1.0, 0.2, 0.4]), 1e-9));
/// assert!((volume.margin(&from_zyz([1.0, 0.2, 0.6])) + 0.1).abs() < 1e-12);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct QuaternionVolume {
    shape: VolumeShape,
    before: UnitQuaternion<f64>,
    after: UnitQuaternion<f64>,
}

#[derive(Debug, Clone, PartialEq)]
enum VolumeShape {
    Cone {
        axis: Unit<Vector3<f64>>,
        half_angle: f64,
    },
    /// The first `count` rotations; the others are the identity.
    Sequence {
        count: usize,
        rotations: [BoundedRotation; 3],
    },
    /// More than three rotations.
    Long(Vec<BoundedRotation>),
}

/// What a volume proposes to a sampler: orientations that are uniform on a set around it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Proposals {
    /// Dimension of the volume.
    pub dimension: usize,
    /// Measure of the set, of which all rotations have `8 pi^2`; below three dimensions the product of the ranges.
    pub measure: f64,
    /// Of a long sequence: middle and radius of the ball.
    ball: Option<(UnitQuaternion<f64>, f64)>,
}

/// The form of a volume's cross-section, see [`QuaternionVolume::cross_section`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SectionShape {
    /// The tool axis does not move.
    Point,
    /// One tilt: about x or about y.
    Line,
    /// Tilts about x and y.
    Square,
    /// A tilt in every direction.
    Disc,
}

impl SectionShape {
    /// The shape as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::Line => "line",
            Self::Square => "square",
            Self::Disc => "disc",
        }
    }
}

impl std::str::FromStr for SectionShape {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let all = [Self::Point, Self::Line, Self::Square, Self::Disc];
        all.into_iter().find(|s| s.as_str() == name).ok_or_else(|| Error::UnknownName {
            kind: "shape",
            name: name.into(),
            valid: all.iter().map(|s| s.as_str().into()).collect(),
        })
    }
}

/// Where the tool axis can meet a plane, see [`QuaternionVolume::cross_section`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossSection {
    /// Its form.
    pub shape: SectionShape,
    /// Range along x, in the unit of the distance.
    pub x: [f64; 2],
    /// Range along y, in the unit of the distance.
    pub y: [f64; 2],
}

/// How the distance of a cross-section is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SectionDistance {
    /// Along the tilted tool axis: `epsilon = d sin(eta)`.
    AlongTool,
    /// Perpendicular to the plane: `epsilon = d tan(eta)`.
    ToPlane,
}

impl QuaternionVolume {
    /// `Rz(alpha) Ry(beta) Rz(gamma)` with ranges `[low, high]`, rad.
    ///
    /// # Errors
    /// A bound that is not finite, or a lower above its upper one.
    pub fn zyz(alpha: [f64; 2], beta: [f64; 2], gamma: [f64; 2]) -> Result<Self> {
        let axes = [[0., 0., 1.], [0., 1., 0.], [0., 0., 1.]];
        Self::from_axes(&axes, &[alpha[0], beta[0], gamma[0]], &[alpha[1], beta[1], gamma[1]])
    }

    /// `Rx(alpha) Ry(beta) Rz(gamma)` with ranges `[low, high]`, rad.
    ///
    /// # Errors
    /// As [`QuaternionVolume::zyz`].
    pub fn xyz(alpha: [f64; 2], beta: [f64; 2], gamma: [f64; 2]) -> Result<Self> {
        let axes = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
        Self::from_axes(&axes, &[alpha[0], beta[0], gamma[0]], &[alpha[1], beta[1], gamma[1]])
    }

    /// Rotations about `axis` by an angle in `range`, rad.
    ///
    /// # Errors
    /// An axis without length, and as [`QuaternionVolume::zyz`].
    pub fn single_axis(axis: [f64; 3], range: [f64; 2]) -> Result<Self> {
        Self::from_axes(&[axis], &[range[0]], &[range[1]])
    }

    /// Tilts of the z axis about x and y within the half-angles, rad, with the spin about z free: XYZ with
    /// `alpha` in +-`half_x`, `beta` in +-`half_y` [FromGravdahl2007, sections 7, 8].
    ///
    /// # Errors
    /// A half-angle outside (0, pi/2).
    pub fn pyramid(half_x: f64, half_y: f64) -> Result<Self> {
        for (what, value) in [("half_x", half_x), ("half_y", half_y)] {
            if !(value > 0.0 && value < FRAC_PI_2) {
                let bound = "in (0, pi/2) rad".into();
                return Err(Error::OutOfRange { what: what.into(), value, bound });
            }
        }
        Self::xyz([-half_x, half_x], [-half_y, half_y], [-PI, PI])
    }

    /// Orientations whose body axis `axis` stays within `half_angle` (rad) of where it is at the identity. The cone
    /// around -z is thus the one around z; for a tool that points down see [`QuaternionVolume::cone_around`].
    ///
    /// # Errors
    /// An axis without length, a half-angle outside (0, pi).
    pub fn cone(axis: [f64; 3], half_angle: f64) -> Result<Self> {
        let cone = Cone::new(axis, axis, half_angle)?;
        let shape = VolumeShape::Cone { axis: cone.body_axis(), half_angle };
        Ok(Self { shape, before: UnitQuaternion::identity(), after: UnitQuaternion::identity() })
    }

    /// Orientations whose body axis `body_axis` lies within `half_angle` (rad) of `direction`.
    ///
    /// # Errors
    /// A vector without length, a half-angle outside (0, pi).
    ///
    /// ```
    /// use redundancy_core::rotation::{QuaternionVolume, from_wxyz};
    /// let down = QuaternionVolume::cone_around([0., 0., 1.], [0., 0., -1.], 0.3)?;
    /// assert!(down.contains(&from_wxyz([0., 0., 1., 0.])?, 0.0));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn cone_around(body_axis: [f64; 3], direction: [f64; 3], half_angle: f64) -> Result<Self> {
        let volume = Self::cone(body_axis, half_angle)?;
        let direction = unit_direction("direction", direction)?;
        Ok(volume.reoriented(&shortest_arc(&unit_direction("body axis", body_axis)?, &direction)))
    }

    /// Rotations about the rows of `axes` by angles between `lower` and `upper`, rad; the first is the outermost.
    ///
    /// # Errors
    /// No axes, bounds of another number, an axis without length, consecutive axes that are
    /// parallel, a bound that is not finite, a lower above its upper one.
    pub fn from_axes(axes: &[[f64; 3]], lower: &[f64], upper: &[f64]) -> Result<Self> {
        let count = axes.len();
        if count == 0 {
            let message = "axes: 0 rotations, a quaternion volume is a sequence of one or more";
            return Err(Error::Invalid(message.into()));
        }
        check_length("lower", lower, count)?;
        check_length("upper", upper, count)?;
        check_finite("lower", lower)?;
        check_finite("upper", upper)?;
        let mut rotations = vec![BoundedRotation::none(); count.max(3)];
        for i in 0..count {
            let (low, high) = (lower[i], upper[i]);
            if low > high {
                let message = format!("rotation {i}: lower bound {low} is above upper bound {high}");
                return Err(Error::Invalid(message));
            }
            rotations[i] =
                BoundedRotation { axis: unit_direction(&format!("axis {i}"), axes[i])?, low, high };
            if i > 0 {
                let sine = rotations[i - 1].axis.cross(&rotations[i].axis).norm();
                if sine < VOLUME_AXES_PARALLEL {
                    let message = format!(
                        "axes {} and {i} are parallel (sine {sine:e}): two rotations about one axis are one, give \
                         the sum of their ranges",
                        i - 1
                    );
                    return Err(Error::Invalid(message));
                }
            }
        }
        let shape = match rotations[..] {
            [a, b, c] => VolumeShape::Sequence { count, rotations: [a, b, c] },
            _ => VolumeShape::Long(rotations),
        };
        Ok(Self { shape, before: UnitQuaternion::identity(), after: UnitQuaternion::identity() })
    }

    /// `P * V`: the set as it is seen when its reference frame is rotated by `p` [FromGravdahl2007, eq. (12)].
    ///
    /// ```
    /// use redundancy_core::rotation::{QuaternionVolume, from_wxyz, from_zyz};
    /// let flip = from_wxyz([0., 0., 1., 0.])?;
    /// let down = QuaternionVolume::cone([0., 0., 1.], 0.3)?.reoriented(&flip);
    /// assert!(down.contains(&(flip * from_zyz([0.5, 0.2, 1.0])), 1e-9));
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn reoriented(&self, p: &UnitQuaternion<f64>) -> Self {
        Self { before: compose(p, &self.before), ..self.clone() }
    }

    /// `V * S`: the set of another frame of the same body, rotated by `s` in body axes.
    pub fn reoriented_in_body(&self, s: &UnitQuaternion<f64>) -> Self {
        Self { after: compose(&self.after, s), ..self.clone() }
    }

    /// Number of bounded rotations; a cone counts 3.
    pub fn dimension(&self) -> usize {
        match self.shape {
            VolumeShape::Cone { .. } => 3,
            VolumeShape::Sequence { count, .. } => count,
            VolumeShape::Long(ref rotations) => rotations.len(),
        }
    }

    /// The set of orientations within a cone.
    pub(super) fn from_cone(cone: &Cone) -> Self {
        let shape = VolumeShape::Cone { axis: cone.body_axis(), half_angle: cone.half_angle() };
        let before = shortest_arc(&cone.body_axis(), &cone.direction());
        Self { shape, before, after: UnitQuaternion::identity() }
    }

    /// The same set as a [`Cone`], when it is one.
    pub fn as_cone(&self) -> Option<Cone> {
        match self.shape {
            VolumeShape::Cone { axis, half_angle } => {
                Some(Cone::from_units(self.after.inverse() * axis, self.before * axis, half_angle))
            }
            _ => None,
        }
    }

    /// The sequence's axes, lower and upper bounds (rad); `None` for a cone.
    pub fn bounds(&self) -> Option<Vec<([f64; 3], f64, f64)>> {
        let bounds = self.rotations()?.iter().map(|r| ([r.axis.x, r.axis.y, r.axis.z], r.low, r.high));
        Some(bounds.collect())
    }

    /// Body axis and half-angle (rad) of a cone before its reorientations; `None` for a sequence.
    pub fn cone_shape(&self) -> Option<([f64; 3], f64)> {
        match self.shape {
            VolumeShape::Cone { axis, half_angle } => Some((axis.into_inner().into(), half_angle)),
            _ => None,
        }
    }

    /// The same set with other reorientations `P` and `S` in place of its own.
    pub fn with_reorientations(&self, before: UnitQuaternion<f64>, after: UnitQuaternion<f64>) -> Self {
        Self { before, after, ..self.clone() }
    }

    /// The reorientations `(P, S)`.
    pub fn reorientations(&self) -> (UnitQuaternion<f64>, UnitQuaternion<f64>) {
        (self.before, self.after)
    }

    /// Whether `q` is a member to the tolerance `tol` (rad; for a cone in its margin's unit).
    pub fn contains(&self, q: &UnitQuaternion<f64>, tol: f64) -> bool {
        if let VolumeShape::Long(rotations) = &self.shape {
            return long_sequence::is_member(rotations, &self.inner(q), tol);
        }
        if self.margin(q) >= -tol {
            return true;
        }
        self.near_edge(q) && rotation_angle(q, &self.nearest(q)) <= tol
    }

    /// Signed margin, >= 0 inside: for sequences the smallest angle (rad) to a bound, for cones that of [`Cone`].
    /// A sequence without any bound has the margin pi.
    pub fn margin(&self, q: &UnitQuaternion<f64>) -> f64 {
        match self.as_cone() {
            Some(cone) => cone.margin(q),
            None => self.best_branch(q).1.min(PI),
        }
    }

    /// The angles of `q` in the sequence, rad: those of the branch with the largest margin, of more than three rotations
    /// those that stay farthest from the bounds. For a cone the ZYZ angles in the frame whose z is the cone's axis.
    pub fn angles(&self, q: &UnitQuaternion<f64>) -> Vec<f64> {
        self.best_branch(q).0
    }

    /// Angles of a cone, or of the better branch of at most three rotations, unused ones 0.
    fn three_angles(&self, q: &UnitQuaternion<f64>) -> [f64; 3] {
        match self.shape {
            VolumeShape::Cone { axis, .. } => {
                let frame = shortest_arc(&Vector3::z_axis(), &axis);
                to_zyz(&compose(&compose(&frame.inverse(), &self.inner(q)), &frame))
            }
            VolumeShape::Sequence { .. } => self.better_branch(q).angles,
            VolumeShape::Long(_) => [0.0; 3],
        }
    }

    /// The orientation at the given angles of the sequence, rad; the inverse of [`angles`](Self::angles). Bounds are
    /// not applied.
    ///
    /// # Errors
    /// Another number of angles than rotations (three for a cone), or one that is not finite.
    ///
    /// ```
    /// use redundancy_core::rotation::{QuaternionVolume, from_xyz, rotation_angle};
    /// let volume = QuaternionVolume::pyramid(0.3, 0.2)?;
    /// assert!(rotation_angle(&volume.at(&[0.1, 0.2, 0.3])?, &from_xyz([0.1, 0.2, 0.3])) < 1e-15);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn at(&self, angles: &[f64]) -> Result<UnitQuaternion<f64>> {
        check_length("angles", angles, self.dimension())?;
        check_finite("angles", angles)?;
        Ok(self.place(angles))
    }

    /// The visualising quaternion of `q`: `(cos psi/2, sin(psi/2) z)` with `z` the rotated last axis (for a cone its
    /// axis) in the reference frame and `psi` the last angle [FromGravdahl2007, eq. (8)].
    ///
    /// ```
    /// use redundancy_core::rotation::{QuaternionVolume, from_zyz, to_wxyz};
    /// let volume = QuaternionVolume::zyz([-3., 3.], [0., 1.], [-3., 3.])?;
    /// let d = f64::to_radians;
    /// let v = to_wxyz(&volume.visualising(&from_zyz([d(30.), d(15.), d(-20.)])));
    /// assert!((v[0] - 0.984807753).abs() < 1e-9 && (v[3] + 0.1677312595).abs() < 1e-9);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn visualising(&self, q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let angles = self.angles(q);
        let (last, psi) = match &self.shape {
            VolumeShape::Cone { axis, .. } => (*axis, angles[2]),
            VolumeShape::Sequence { count, rotations } => (rotations[count - 1].axis, angles[count - 1]),
            VolumeShape::Long(rotations) => {
                let last = rotations.len() - 1;
                (rotations[last].axis, angles[last])
            }
        };
        about(&(self.before * (self.inner(q) * last)), psi)
    }

    /// The member nearest to `q`, on the side of `q` in the double cover; `q` itself when it is a member.
    ///
    /// For a sequence the squared dot product with `q` is maximised over the box of angles, see `sequence`; for a cone it
    /// is the rim point on the arc to the axis.
    pub fn nearest(&self, q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        // Not by `contains`, which asks for the nearest member next to the gimbal.
        let inside = match &self.shape {
            VolumeShape::Long(rotations) => long_sequence::is_member(rotations, &self.inner(q), 0.0),
            _ => self.margin(q) >= 0.0,
        };
        if inside {
            return *q;
        }
        match (&self.shape, self.as_cone()) {
            (VolumeShape::Cone { half_angle, .. }, Some(cone)) => {
                let (from, to) = (q * cone.body_axis(), cone.direction());
                let angle = angle_between(&from, &to);
                let arc = shortest_arc(&from, &to);
                let axis = Unit::try_new(arc.imag(), 0.0).unwrap_or(Vector3::z_axis());
                compose(&about(&axis, angle - half_angle), q)
            }
            (VolumeShape::Sequence { count, rotations }, _) => {
                nearest_sign(self.place(&nearest_angles(*count, rotations, &self.inner(q))), q)
            }
            (VolumeShape::Long(rotations), _) => {
                nearest_sign(self.place(&long_sequence::nearest(rotations, &self.inner(q))), q)
            }
            _ => *q,
        }
    }

    /// `n` members, drawn uniformly with respect to the invariant measure of rotations (on a set of one or two
    /// rotations: that of its angles); the same seed gives the same bits.
    ///
    /// The middle angle is drawn with the weight `|sin(phi_2 - atan2(C, B))|`, and members that the box describes
    /// twice are kept half of the time. Of more than three rotations, orientations of a ball around the set are drawn and
    /// members kept; where a hundred thousand in a row are none (ranges of less than some milliradians), the
    /// angles are drawn uniformly instead.
    pub fn sample(&self, n: usize, seed: u64) -> Vec<UnitQuaternion<f64>> {
        self.sampler(seed).take(n).collect()
    }

    /// The members that [`sample`](Self::sample) draws, one by one and without end.
    pub fn sampler(&self, seed: u64) -> impl Iterator<Item = UnitQuaternion<f64>> + Send + '_ {
        let (mut random, proposals) = (ChaCha8Rng::seed_from_u64(seed), self.proposals());
        std::iter::repeat_with(move || self.draw(&proposals, &mut random))
    }

    /// Where the tool axis z meets the plane perpendicular to its undisturbed direction, `distance` away, before any
    /// reorientation [FromGravdahl2007, section 8]: a rotation by `eta` about y moves it by `epsilon(eta)` along x, one
    /// about x by `-epsilon(eta)` along y. Print has `epsilon = d sin(eta)`, which holds for a distance along the tool;
    /// perpendicular to the plane it is `d tan(eta)`. The extents of a square are those on its axes: its sides bulge
    /// by `1 / cos`.
    ///
    /// # Errors
    /// A distance that is not positive and finite, a tilt of 90 degrees or more, or a volume whose section has no
    /// name (known: a cone around z, a rotation about x, y or z, x then y, XYZ, and ZYZ with `alpha` free and `beta`
    /// from 0).
    ///
    /// ```
    /// use redundancy_core::rotation::{QuaternionVolume, SectionDistance, SectionShape};
    /// let section = QuaternionVolume::pyramid(0.2, 0.1)?.cross_section(0.5, SectionDistance::ToPlane)?;
    /// assert_eq!(section.shape, SectionShape::Square);
    /// assert!((section.x[1] - 0.5 * 0.1_f64.tan()).abs() < 1e-15);
    /// # Ok::<(), redundancy_core::Error>(())
    /// ```
    pub fn cross_section(&self, distance: f64, measured: SectionDistance) -> Result<CrossSection> {
        if !(distance > 0.0 && distance.is_finite()) {
            let bound = "positive and finite".into();
            return Err(Error::OutOfRange { what: "distance".into(), value: distance, bound });
        }
        let epsilon = |eta: f64| -> Result<f64> {
            if eta.abs() >= FRAC_PI_2 {
                let bound = "below pi/2 rad in size for a cross-section".into();
                return Err(Error::OutOfRange { what: "tilt".into(), value: eta, bound });
            }
            Ok(distance * if measured == SectionDistance::AlongTool { eta.sin() } else { eta.tan() })
        };
        let along = |r: &BoundedRotation| Ok::<_, Error>([epsilon(r.low)?, epsilon(r.high)?]);
        let mirrored = |r: &BoundedRotation| Ok::<_, Error>([-epsilon(r.high)?, -epsilon(r.low)?]);
        let section = |shape, x, y| Ok(CrossSection { shape, x, y });
        let disc = |eta: f64| epsilon(eta).and_then(|e| section(SectionShape::Disc, [-e, e], [-e, e]));
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        match &self.shape {
            VolumeShape::Cone { axis, half_angle } if *axis == z => disc(*half_angle),
            VolumeShape::Sequence { count, rotations: [one, two, three] } => {
                let axes = [one.axis, two.axis, three.axis];
                if *count == 1 && axes[0] == z {
                    section(SectionShape::Point, [0.0; 2], [0.0; 2])
                } else if *count == 1 && axes[0] == x {
                    section(SectionShape::Line, [0.0; 2], mirrored(one)?)
                } else if *count == 1 && axes[0] == y {
                    section(SectionShape::Line, along(one)?, [0.0; 2])
                } else if axes[0] == x && axes[1] == y && (*count == 2 || axes[2] == z) {
                    section(SectionShape::Square, along(two)?, mirrored(one)?)
                } else if *count == 3 && axes == [z, y, z] && one.free() && two.low <= 0.0 && two.high >= 0.0
                {
                    disc(two.high.max(-two.low))
                } else {
                    Err(no_section())
                }
            }
            VolumeShape::Cone { .. } | VolumeShape::Long(_) => Err(no_section()),
        }
    }

    /// `conj(P) * q * conj(S)`.
    fn inner(&self, q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        compose(&compose(&self.before.inverse(), q), &self.after.inverse())
    }

    /// The rotations of a sequence.
    fn rotations(&self) -> Option<&[BoundedRotation]> {
        match &self.shape {
            VolumeShape::Cone { .. } => None,
            VolumeShape::Sequence { count, rotations } => Some(&rotations[..*count]),
            VolumeShape::Long(rotations) => Some(rotations),
        }
    }

    /// The member at these angles.
    fn place(&self, angles: &[f64]) -> UnitQuaternion<f64> {
        let inner = match (&self.shape, angles) {
            (VolumeShape::Cone { axis, .. }, [a, b, c]) => {
                let frame = shortest_arc(&Vector3::z_axis(), axis);
                compose(&compose(&frame, &from_zyz([*a, *b, *c])), &frame.inverse())
            }
            _ => long_sequence::place(self.rotations().unwrap_or_default(), angles),
        };
        compose(&compose(&self.before, &inner), &self.after)
    }

    /// Angles and margin of the way to write `q` that stays farthest from the bounds.
    fn best_branch(&self, q: &UnitQuaternion<f64>) -> (Vec<f64>, f64) {
        match &self.shape {
            VolumeShape::Cone { .. } => (self.three_angles(q).to_vec(), self.margin(q)),
            VolumeShape::Sequence { count, .. } => {
                let best = self.better_branch(q);
                (best.angles[..*count].to_vec(), best.margin)
            }
            VolumeShape::Long(rotations) => {
                let written = long_sequence::best(rotations, &self.inner(q));
                (written.angles, written.margin)
            }
        }
    }

    fn better_branch(&self, q: &UnitQuaternion<f64>) -> SequenceBranch {
        match self.branches(q) {
            (first, Some(second)) if second.margin > first.margin => second,
            (first, _) => first,
        }
    }

    /// One or two ways to write `q`; the first is the one with the smaller middle angle.
    fn branches(&self, q: &UnitQuaternion<f64>) -> (SequenceBranch, Option<SequenceBranch>) {
        let inner = self.inner(q);
        match &self.shape {
            VolumeShape::Sequence { count: 1, rotations } => (one_rotation(&rotations[0], &inner), None),
            VolumeShape::Sequence { count: 2, rotations } => (two_rotations(rotations, &inner), None),
            VolumeShape::Sequence { rotations, .. } => three_rotations(rotations, &inner),
            _ => (SequenceBranch { angles: self.three_angles(q), margin: self.margin(q) }, None),
        }
    }

    /// Where the margin is less exact than membership: next to the gimbal of three rotations.
    fn near_edge(&self, q: &UnitQuaternion<f64>) -> bool {
        match &self.shape {
            VolumeShape::Sequence { count: 3, rotations: [one, _, three] } => {
                let last = self.inner(q) * three.axis;
                one.axis.cross(&last).norm() < VOLUME_NEAR_GIMBAL
            }
            _ => false,
        }
    }

    /// What it proposes to a sampler.
    pub(super) fn proposals(&self) -> Proposals {
        let all = 8.0 * PI * PI;
        match &self.shape {
            VolumeShape::Cone { half_angle, .. } => {
                let measure = all * (0.5 * half_angle).sin().powi(2);
                Proposals { dimension: 3, measure, ball: None }
            }
            VolumeShape::Sequence { count: 3, rotations } => {
                let [one, two, three] = rotations;
                // |n_1 . R n_2 x n_3| is the density of the invariant measure in the angles.
                let size = one.axis.cross(&two.axis).norm() * two.axis.cross(&three.axis).norm();
                let zero = middle_zero(rotations);
                let (low, high) = (two.centre() - two.half(), two.centre() + two.half());
                let measure = size * 4.0 * one.half() * three.half() * middle_weight(low, high, zero);
                Proposals { dimension: if measure > 0.0 { 3 } else { 2 }, measure, ball: None }
            }
            _ => {
                let rotations = self.rotations().unwrap_or_default();
                let wide: Vec<f64> =
                    rotations.iter().map(BoundedRotation::half).filter(|h| *h > 0.0).collect();
                if wide.len() < 3 || rotations.len() < 3 {
                    let measure = wide.iter().map(|half| 2.0 * half).product();
                    return Proposals { dimension: wide.len(), measure, ball: None };
                }
                let middle: Vec<f64> = rotations.iter().map(BoundedRotation::centre).collect();
                let radius = wide.iter().sum::<f64>().min(PI);
                let measure = all * (radius - radius.sin()) / PI;
                Proposals { dimension: 3, measure, ball: Some((self.place(&middle), radius)) }
            }
        }
    }

    /// A member, each with the same density where one comes; `None` where the proposal is to be left out.
    pub(super) fn propose(
        &self,
        proposals: &Proposals,
        random: &mut ChaCha8Rng,
    ) -> Option<UnitQuaternion<f64>> {
        if let Some((middle, radius)) = proposals.ball {
            let q = compose(&in_ball(radius, random), &middle);
            return self.contains(&q, 0.0).then_some(q);
        }
        let mut between = |low: f64, high: f64| low + (high - low) * unit_interval(random);
        match &self.shape {
            VolumeShape::Cone { half_angle, .. } => {
                // The area of a cap grows with sin^2 of half its half-angle.
                let share = between(0.0, 1.0);
                let tilt = 2.0 * ((0.5 * half_angle).sin() * share.sqrt()).asin();
                Some(self.place(&[between(-PI, PI), tilt, between(-PI, PI)]))
            }
            VolumeShape::Sequence { count: 3, rotations } => {
                let mut angles = [0.0; 3];
                for (i, (angle, r)) in angles.iter_mut().zip(rotations).enumerate() {
                    let (low, high) = (r.centre() - r.half(), r.centre() + r.half());
                    *angle = if i == 1 {
                        weighted_middle(low, high, middle_zero(rotations), between(0.0, 1.0))
                    } else {
                        between(low, high)
                    };
                }
                let q = self.place(&angles);
                let twice = matches!(self.branches(&q), (a, Some(b)) if a.margin >= 0.0 && b.margin >= 0.0);
                (!twice || between(0.0, 1.0) < 0.5).then_some(q)
            }
            _ => Some(self.by_angles(random)),
        }
    }

    /// A member with angles that are uniform in their ranges.
    fn by_angles(&self, random: &mut ChaCha8Rng) -> UnitQuaternion<f64> {
        let rotations = self.rotations().unwrap_or_default().iter();
        let angles: Vec<f64> =
            rotations.map(|r| r.centre() + r.half() * (2.0 * unit_interval(random) - 1.0)).collect();
        self.place(&angles)
    }

    fn draw(&self, proposals: &Proposals, random: &mut ChaCha8Rng) -> UnitQuaternion<f64> {
        for _ in 0..DRAWS {
            if let Some(q) = self.propose(proposals, random) {
                return q;
            }
        }
        self.by_angles(random)
    }
}

/// Draws of a long sequence's ball without a member before its angles are drawn instead.
const DRAWS: usize = 100_000;

/// A rotation by at most `radius` (rad, up to pi), uniform with respect to the invariant measure.
fn in_ball(radius: f64, random: &mut ChaCha8Rng) -> UnitQuaternion<f64> {
    // The measure up to an angle t grows with t - sin t.
    let share = unit_interval(random) * (radius - radius.sin());
    let (mut low, mut high) = (0.0, radius);
    for _ in 0..f64::MANTISSA_DIGITS {
        let middle = 0.5 * (low + high);
        if middle - f64::sin(middle) < share { low = middle } else { high = middle }
    }
    let z = 2.0 * unit_interval(random) - 1.0;
    let (sin, cos) = (2.0 * PI * unit_interval(random)).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    about(&Unit::new_unchecked(Vector3::new(across * cos, across * sin, z)), low)
}

fn no_section() -> Error {
    Error::Invalid(
        "this volume's cross-section has no name; known are a cone around z (disc), a rotation about x or y (line) or \
         z (point), x then y and XYZ (square), ZYZ with alpha free and beta around 0 (disc)"
            .into(),
    )
}

/// 53 random bits in [0, 1).
pub(super) fn unit_interval(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}
