//! Rules that give a tool orientation from the position on the surface alone.
//!
//! # Problem
//! A spray gun may lean by some angle and spin about its axis without harm. The rules of the papers use that freedom point by
//! point, so that the wrist moves less than the gun: [FromGravdahl2007, sections 6 to 8] and [FromGravdahl2009, V].
//!
//! Positions are in the world frame, z is normal to the surface. `Q_e` is the orientation that a tool without freedom would
//! have, by default `Ry(pi)`: the tool axis points down. The surface is given by its centre and its extents.
//!
//! | rule | orientation |
//! |---|---|
//! | constant | `Q_e` |
//! | pointing | `F = Rz(phi) Q_e`, `phi = atan2(y, x)` [FromGravdahl2007, eq. (49)] |
//! | tilt, square | `Rx(e_y) Ry(-e_x) F`, `e_x = e (x - x0) / max abs(x - x0)`, likewise `e_y` |
//! | tilt, disc | least rotation of the tool axis towards the offset from the centre, by `e r / max r`, then `F` |
//! | barrier, cone (V1) | `swing(z) Q_e`, with `z` the best axis between the cones around `u` (half-angle beta) and `c` (alpha) |
//! | barrier, two cones (V2) | as V1 with a cone of half-angle gamma around `-(cos phi, sin phi, 0)` for the tool's x |
//! | barrier, spin (V3) | `swing(z) F` with the axis of V1 |
//!
//! `u` is the tool axis of `Q_e`; `c` looks from a point `distance` above the centre to the position. [FromGravdahl2007, (49)]
//! is printed with the sign for another frame and [FromGravdahl2009, (41)] jumps where `x = x_cent`; both are
//! `atan2(y, x)` here.
//!
//! Cost: below 0.3 us per point, V2 about 1 us. References: [FromGravdahl2007], [FromGravdahl2009].

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::Status;
use crate::error::{Error, Result, check_finite};
use crate::pose::checked_rotation;
use crate::rotation::{Barrier, Cone, OrientationOptimizer, OrientationSettings, TwoCones, shortest_arc};
use crate::tolerance::DIRECTION_NORM;

/// The part of the plane that a path covers, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Its centre.
    pub center: [f64; 2],
    /// Largest distance from the centre along x and y.
    pub half_extents: [f64; 2],
    /// Largest distance from the centre.
    pub radius: f64,
}

impl Surface {
    /// The bounding rectangle of positions, and the circle around its centre that holds them.
    pub fn around(positions: &[Vector3<f64>]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in positions {
            for i in 0..2 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        if positions.is_empty() {
            return Self { center: [0.0; 2], half_extents: [0.0; 2], radius: 0.0 };
        }
        let center = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        let half_extents = [0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1])];
        let radius = positions.iter().map(|p| (p.x - center[0]).hypot(p.y - center[1])).fold(0.0, f64::max);
        Self { center, half_extents, radius }
    }
}

/// What turns the tool about its axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RuleSpin {
    /// It follows the direction from the base, `atan2(y, x)`.
    Pointing,
    /// Nothing.
    Constant,
}

/// Half-angles, weights and distance of the barrier rules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BarrierRule {
    /// Half-angle of the cone around the tool axis of `Q_e`, rad.
    pub beta: f64,
    /// Half-angle of the cone around the direction to the position, rad.
    pub alpha: f64,
    /// Weight of the first barrier.
    pub k_err: f64,
    /// Weight of the second barrier.
    pub k_tcp: f64,
    /// Height (m) above the centre of the point that the tool should look from.
    pub distance: f64,
}

impl Default for BarrierRule {
    /// The constants of the reference paths: 20 degrees, weights of 1, 0.4 m.
    fn default() -> Self {
        let angle = 20f64.to_radians();
        Self { beta: angle, alpha: angle, k_err: 1.0, k_tcp: 1.0, distance: 0.4 }
    }
}

/// Which rule.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum RuleKind {
    /// The same everywhere.
    Constant,
    /// Only the spin follows the position.
    Pointing,
    /// Lean up to `angle` (rad) along x and along y.
    TiltSquare {
        /// Largest lean along each axis, rad.
        angle: f64,
        /// Spin about the tool axis.
        spin: RuleSpin,
    },
    /// Lean up to `angle` (rad) in any direction.
    TiltDisc {
        /// Largest lean, rad.
        angle: f64,
        /// Spin about the tool axis.
        spin: RuleSpin,
    },
    /// V1: cones for the tool axis.
    BarrierCone(BarrierRule),
    /// V2: cones for the tool axis and one for the tool's x, of half-angle `gamma` (rad) and weight `k_x`.
    BarrierTwoCones {
        /// The cones for the axis.
        axis: BarrierRule,
        /// Half-angle of the cone for the tool's x, rad.
        gamma: f64,
        /// Its weight.
        k_x: f64,
    },
    /// V3: cones for the tool axis, no twist against the pointing frame.
    BarrierSpin(BarrierRule),
}

/// A rule with the orientation and the surface that it refers to.
///
/// ```
/// use redundancy_core::nalgebra::Vector3;
/// use redundancy_core::planning::{OrientationRule, RuleKind, RuleSpin};
/// let rule = OrientationRule::new(RuleKind::TiltDisc { angle: 0.2, spin: RuleSpin::Constant })?;
/// let row = [Vector3::new(0.4, -0.2, 0.0), Vector3::new(0.5, 0.0, 0.0), Vector3::new(0.6, 0.2, 0.0)];
/// let turned = rule.orientations(&row)?;
/// assert!((turned[1] * Vector3::z() + Vector3::z()).norm() < 1e-15); // straight down over the centre
/// assert!(((turned[2] * Vector3::z()).dot(&-Vector3::z()) - 0.2f64.cos()).abs() < 1e-15);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct OrientationRule {
    kind: RuleKind,
    orientation: Rotation3<f64>,
    surface: Option<Surface>,
    /// What the kind needs, made once: the two cones of the axis, and all cones of V2.
    cones: Option<TwoCones>,
    optimizer: Option<OrientationOptimizer>,
}

impl PartialEq for OrientationRule {
    fn eq(&self, other: &Self) -> bool {
        (self.kind, self.orientation, self.surface) == (other.kind, other.orientation, other.surface)
    }
}

/// The tool axis points down: `Ry(pi)`.
pub fn tool_down() -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(Matrix3::new(-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0))
}

impl OrientationRule {
    /// The rule with the tool down and the surface taken from the positions of each call.
    ///
    /// # Errors
    /// An angle outside (0, pi/2), a weight or distance that is not positive and finite.
    pub fn new(kind: RuleKind) -> Result<Self> {
        let angle_ok = |what: &str, value: f64| {
            if value > 0.0 && value < std::f64::consts::FRAC_PI_2 {
                return Ok(());
            }
            Err(Error::OutOfRange { what: what.into(), value, bound: "in (0, pi/2) rad".into() })
        };
        let mut optimizer = None;
        let cones = match &kind {
            RuleKind::Constant | RuleKind::Pointing => None,
            RuleKind::TiltSquare { angle, .. } | RuleKind::TiltDisc { angle, .. } => {
                angle_ok("angle", *angle)?;
                None
            }
            RuleKind::BarrierCone(b)
            | RuleKind::BarrierSpin(b)
            | RuleKind::BarrierTwoCones { axis: b, .. } => {
                if !(b.distance > 0.0 && b.distance.is_finite()) {
                    let bound = "positive and finite".into();
                    return Err(Error::OutOfRange { what: "distance".into(), value: b.distance, bound });
                }
                if let RuleKind::BarrierTwoCones { gamma, k_x, .. } = &kind {
                    let barriers = vec![
                        Barrier::new(b.k_err, Cone::downward(b.beta)?)?,
                        Barrier::new(b.k_tcp, Cone::downward(b.alpha)?)?,
                        Barrier::new(*k_x, Cone::x([1.0, 0.0, 0.0], *gamma)?)?,
                    ];
                    optimizer = Some(OrientationOptimizer::new(barriers, OrientationSettings::default())?);
                }
                Some(TwoCones::new(b.beta, b.alpha, b.k_err, b.k_tcp)?)
            }
        };
        Ok(Self { kind, orientation: tool_down(), surface: None, cones, optimizer })
    }

    /// The same rule around another orientation without freedom.
    ///
    /// # Errors
    /// A matrix that is no rotation.
    pub fn with_orientation(mut self, orientation: Rotation3<f64>) -> Result<Self> {
        let matrix = checked_rotation("orientation", orientation.matrix())?;
        self.orientation = Rotation3::from_matrix_unchecked(matrix);
        Ok(self)
    }

    /// The same rule on a surface that is known beforehand; then each position can be asked for on its own.
    ///
    /// # Errors
    /// Numbers that are not finite, extents that are negative.
    pub fn with_surface(mut self, surface: Surface) -> Result<Self> {
        check_finite("centre of the surface", &surface.center)?;
        for (what, value) in [
            ("half extent along x", surface.half_extents[0]),
            ("half extent along y", surface.half_extents[1]),
            ("radius", surface.radius),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange { what: what.into(), value, bound: "finite and >= 0".into() });
            }
        }
        self.surface = Some(surface);
        Ok(self)
    }

    /// Which rule.
    pub fn kind(&self) -> &RuleKind {
        &self.kind
    }

    /// The orientation of a tool without freedom.
    pub fn orientation(&self) -> &Rotation3<f64> {
        &self.orientation
    }

    /// The surface, where one was given.
    pub fn surface(&self) -> Option<&Surface> {
        self.surface.as_ref()
    }

    /// One orientation per position. Without a surface of its own the rule takes the one around these positions.
    ///
    /// # Errors
    /// A position that is not finite; cones that miss each other: the message names the row and the angle.
    pub fn orientations(&self, positions: &[Vector3<f64>]) -> Result<Vec<Rotation3<f64>>> {
        for (i, p) in positions.iter().enumerate() {
            check_finite(&format!("position {i}"), p.as_slice())?;
        }
        let surface = self.surface.unwrap_or_else(|| Surface::around(positions));
        let mut optimizer = self.optimizer.clone();
        positions.iter().enumerate().map(|(i, p)| self.at(i, p, &surface, &mut optimizer)).collect()
    }

    fn at(
        &self,
        row: usize,
        p: &Vector3<f64>,
        surface: &Surface,
        optimizer: &mut Option<OrientationOptimizer>,
    ) -> Result<Rotation3<f64>> {
        let (dx, dy) = (p.x - surface.center[0], p.y - surface.center[1]);
        // Beyond the extents the lean stays at its largest.
        let share = |d: f64, most: f64| if most > 0.0 { (d / most).clamp(-1.0, 1.0) } else { 0.0 };
        let frame = |spin: RuleSpin| match spin {
            RuleSpin::Constant => self.orientation,
            RuleSpin::Pointing => turned_z(p) * self.orientation,
        };
        match &self.kind {
            RuleKind::Constant => Ok(self.orientation),
            RuleKind::Pointing => Ok(frame(RuleSpin::Pointing)),
            RuleKind::TiltSquare { angle, spin } => {
                let (ex, ey) =
                    (angle * share(dx, surface.half_extents[0]), angle * share(dy, surface.half_extents[1]));
                let lean = Rotation3::from_axis_angle(&Vector3::x_axis(), ey)
                    * Rotation3::from_axis_angle(&Vector3::y_axis(), -ex);
                Ok(lean * frame(*spin))
            }
            RuleKind::TiltDisc { angle, spin } => {
                let axis = self.orientation * Vector3::z();
                let offset = Vector3::new(dx, dy, 0.0);
                // About the axis across the tool and the offset; where they are parallel there is no lean.
                let across = Unit::try_new(axis.cross(&offset), DIRECTION_NORM);
                let turn = angle * share(offset.norm(), surface.radius);
                let lean = across.map_or_else(Rotation3::identity, |a| Rotation3::from_axis_angle(&a, turn));
                Ok(lean * frame(*spin))
            }
            RuleKind::BarrierCone(rule) => {
                Ok(self.swing(row, [dx, dy], rule)?.to_rotation_matrix() * self.orientation)
            }
            RuleKind::BarrierSpin(rule) => {
                Ok(self.swing(row, [dx, dy], rule)?.to_rotation_matrix() * frame(RuleSpin::Pointing))
            }
            RuleKind::BarrierTwoCones { axis: rule, .. } => {
                let start = self.swing(row, [dx, dy], rule)?.to_rotation_matrix() * frame(RuleSpin::Pointing);
                let u = Unit::new_unchecked(self.orientation * Vector3::z());
                let c = self.wanted([dx, dy], rule)?;
                let b = Unit::new_unchecked(frame(RuleSpin::Pointing) * Vector3::x());
                let Some(optimizer) = optimizer else {
                    return Err(Error::Invalid(format!("position {row}: the rule has no cones")));
                };
                optimizer.turn_to(&[u, c, b]);
                let best = optimizer.solve(Some(&UnitQuaternion::from_rotation_matrix(&start)));
                if best.status == Status::Infeasible {
                    return Err(missed(row, best.miss_angle));
                }
                Ok(best.q.to_rotation_matrix())
            }
        }
    }

    /// The direction from above the centre to the position.
    fn wanted(&self, [dx, dy]: [f64; 2], rule: &BarrierRule) -> Result<Unit<Vector3<f64>>> {
        let c = Vector3::new(dx, dy, 0.0) + self.orientation * Vector3::z() * rule.distance;
        Unit::try_new(c, DIRECTION_NORM).ok_or_else(|| Error::ZeroDirection {
            what: "direction to the position".into(),
            norm: c.norm(),
            minimum: DIRECTION_NORM,
        })
    }

    /// Least rotation of the tool axis of `Q_e` to the best one between the cones.
    fn swing(&self, row: usize, offset: [f64; 2], rule: &BarrierRule) -> Result<UnitQuaternion<f64>> {
        let u = Unit::new_unchecked(self.orientation * Vector3::z());
        let Some(cones) = &self.cones else { return Ok(UnitQuaternion::identity()) };
        let best = cones.minimum(&u, &self.wanted(offset, rule)?);
        if best.status == Status::Infeasible {
            return Err(missed(row, best.miss_angle));
        }
        Ok(shortest_arc(&u, &best.direction))
    }
}

fn missed(row: usize, angle: f64) -> Error {
    Error::Invalid(format!(
        "position {row}: the cones of the rule miss each other by {angle:.4} rad; widen beta or alpha, or raise distance"
    ))
}

/// `Rz(atan2(y, x))`, the identity over the origin.
fn turned_z(p: &Vector3<f64>) -> Rotation3<f64> {
    let r = p.x.hypot(p.y);
    if r < DIRECTION_NORM {
        return Rotation3::identity();
    }
    let (c, s) = (p.x / r, p.y / r);
    Rotation3::from_matrix_unchecked(Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0))
}
