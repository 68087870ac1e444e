//! The rings of `(x, y)` over a pose, and the lenses on them where a configuration exists.
//!
//! `|W - S|^2` is a sinusoid of x (joint 7) and a sinusoid of y (joint 4), so both are tied by
//! `p := t cos y = s cos x - e` with `s, t >= 0`. On the torus of both angles this is one of:
//!
//! - `s + |e| <= t`: two rings over all x, y above and below (the elbow never stretches or folds);
//! - `t + |e| <= s`: two rings over all y, x above and below;
//! - `e > |s - t|`: one ring about `(0, pi)`, `sin(x/2) = a sin w`, `cos(y/2) = b cos w` with `2 s a^2 = 2 t b^2 = s + t - e`;
//! - `-e > |s - t|`: one ring about `(pi, 0)`, `cos(x/2) = a cos w`, `sin(y/2) = b sin w`, the same with `s + t + e`;
//! - `|e| > s + t`: nothing, the pose is out of reach.
//!
//! The parameter w (x or y itself on the first two) is regular everywhere, folds of x and y included.
//!
//! On a ring the room `(W - S) . normal^2` is an analytic function of w with at most eight zeros over all rings. Where it is
//! positive there are two configurations, with the normal on either side; at its zeros they meet. An interval `[c - h, c + h]`
//! of w between two zeros is a *lens*: `w = c - h cos u`, the normal has the sign of `sin u`, and u is regular at both
//! ends. A ring without zeros is two whole curves with `u = w`.

use std::f64::consts::PI;

use smallvec::{SmallVec, smallvec};
use wide::f64x4;

use super::geometry::PandaGeometry;
use super::target::{Places, Target};
use crate::joint_space::TURN;
use crate::solutions::closed_form::lanes::{Turns, all};
use crate::tolerance::{ARC_BAND, ARC_BEND, REACH_ROUNDING, ROOM_ROUNDING, ROOT_WIDTH};

/// Parts into which a ring is cut at first; multiples of a quarter turn are among the cuts.
const PARTS: usize = 32;
/// Most parts of a ring that are looked at: where the room is nothing but rounding it changes its sign everywhere. Usual are
/// some hundred. The proof of `proof.rs` does not decide such a ring, so that nothing is called proven.
const MOST_PARTS: usize = 20_000;

/// Which of the cases of the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// Over all x; the sign of `sin y`.
    OverX(f64),
    /// Over all y; the sign of `sin x`.
    OverY(f64),
    /// About `(0, pi)`.
    Stretched,
    /// About `(pi, 0)`.
    Folded,
}

/// One ring, see the module.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ring {
    pub kind: Kind,
    pub s: f64,
    pub t: f64,
    pub e: f64,
    /// `a, b`.
    pub radii: [f64; 2],
    /// `1 - a^2`, `1 - b^2`.
    pub rests: [f64; 2],
}

/// A curve on a ring.
#[derive(Debug, Clone, Copy)]
pub(super) enum Sheet {
    /// Between two zeros of the room: centre and half width in w.
    Lens { ring: Ring, center: f64, half: f64 },
    /// All around; the sign of the normal.
    Whole { ring: Ring, sign: f64 },
}

/// The curves on a ring. At most four lie on one, unless rounding makes more.
pub(super) type Sheets = SmallVec<[Sheet; 4]>;

/// Room and slope at a parameter of a ring.
#[derive(Debug, Clone, Copy)]
struct Sample {
    w: f64,
    room: f64,
    slope: f64,
}

/// By how much a pose is out of reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Miss {
    /// Least distance of the wrist from the shoulder over all joints 7, less what the elbow reaches, m.
    TooFar(f64),
    /// What the elbow reaches at least, less the greatest distance of the wrist from the shoulder, m.
    TooNear(f64),
    /// Angle (rad) that axes 5 and 6 would have to make beyond what they do.
    Bend(f64),
}

impl Ring {
    /// The rings over a pose, or by how much the elbow misses it.
    pub fn all(target: &Target) -> Result<SmallVec<[Self; 2]>, Miss> {
        let (s, t) = (target.swing_x, target.swing_y);
        let e = target.mean_x - target.mean_y;
        let slack = REACH_ROUNDING * (target.mean_x + target.mean_y);
        if e.abs() > s + t + slack {
            let reach = |squared: f64| squared.max(0.0).sqrt();
            let [low_x, high_x] = [-s, s].map(|d| reach(target.mean_x + d));
            let [low_y, high_y] = [-t, t].map(|d| reach(target.mean_y + d));
            return Err(if e > 0.0 { Miss::TooFar(low_x - high_y) } else { Miss::TooNear(low_y - high_x) });
        }
        let ring = |kind, twice: f64, rests: [f64; 2]| {
            let twice = twice.max(0.0);
            let root = |d: f64| if d > 0.0 { (0.5 * twice / d).sqrt().min(1.0) } else { 0.0 };
            let rests = rests.map(|rest| rest.max(0.0));
            Self { kind, s, t, e, radii: [root(s), root(t)], rests }
        };
        let plain = |kind| ring(kind, 0.0, [1.0, 1.0]);
        Ok(if s + e.abs() <= t {
            [plain(Kind::OverX(1.0)), plain(Kind::OverX(-1.0))].into()
        } else if t + e.abs() <= s {
            [plain(Kind::OverY(1.0)), plain(Kind::OverY(-1.0))].into()
        } else if e > 0.0 {
            let rests = [0.5 * (s + e - t) / s, 0.5 * (t + e - s) / t];
            smallvec![ring(Kind::Stretched, s + t - e, rests)]
        } else {
            let rests = [0.5 * (s - t - e) / s, 0.5 * (t - s - e) / t];
            smallvec![ring(Kind::Folded, s + t + e, rests)]
        })
    }

    /// The angles and their rates at w.
    #[inline(always)]
    pub fn at(&self, w: f64x4) -> (Turns, Turns, [f64x4; 2]) {
        let (sin, cos) = w.sin_cos();
        let (s, t, e) = (all(self.s), all(self.t), all(self.e));
        let one = all(1.0);
        let tiny = all(f64::MIN_POSITIVE);
        // The other angle from its cosine times `amplitude`, and its rate.
        let other = |cosine: f64x4, amplitude: f64x4, sign: f64, push: f64x4| {
            let product = ((amplitude - cosine) * (amplitude + cosine)).fast_max(all(0.0));
            let sine = product.sqrt() * all(sign);
            let turn = Turns::along(cosine, sine, 0.0, [1.0, 0.0]);
            let divisor = if sign < 0.0 { sine.fast_min(-tiny) } else { sine.fast_max(tiny) };
            (turn, push / divisor)
        };
        // Both half angles of a ring about a crossing: `sin = a sin w`, `cos = b cos w`, and their rates.
        let [a, b] = self.radii.map(all);
        let [rest_a, rest_b] = self.rests.map(all);
        let two = all(2.0);
        let root_a = |v: f64x4, u: f64x4| (u * u + rest_a * v * v).sqrt();
        let root_b = |v: f64x4, u: f64x4| (u * u + rest_b * v * v).sqrt();
        match self.kind {
            Kind::OverX(sign) => {
                let (y, rate) = other(s * cos - e, t, sign, s * sin);
                (Turns { cos, sin }, y, [one, rate])
            }
            Kind::OverY(sign) => {
                let (x, rate) = other(t * cos + e, s, sign, t * sin);
                (x, Turns { cos, sin }, [rate, one])
            }
            Kind::Stretched => {
                let (sine, cosine) = (a * sin, root_a(sin, cos));
                let x = Turns { cos: one - two * sine * sine, sin: two * sine * cosine };
                let (cosy, siny) = (b * cos, root_b(cos, sin));
                let y = Turns { cos: two * cosy * cosy - one, sin: two * siny * cosy };
                (x, y, [two * a * cos / cosine.fast_max(tiny), two * b * sin / siny.fast_max(tiny)])
            }
            Kind::Folded => {
                let (cosine, sine) = (a * cos, root_a(cos, sin));
                let x = Turns { cos: two * cosine * cosine - one, sin: two * sine * cosine };
                let (siny, cosy) = (b * sin, root_b(sin, cos));
                let y = Turns { cos: one - two * siny * siny, sin: two * siny * cosy };
                (x, y, [two * a * sin / sine.fast_max(tiny), two * b * cos / cosy.fast_max(tiny)])
            }
        }
    }

    /// The room at a parameter.
    pub fn room(&self, g: &PandaGeometry, target: &Target, w: f64) -> f64 {
        self.samples(g, target, [w; 4])[0].room
    }

    /// Room and slope at four parameters.
    fn samples(&self, g: &PandaGeometry, target: &Target, w: [f64; 4]) -> [Sample; 4] {
        let (x, y, rates) = self.at(f64x4::new(w));
        let one = all(1.0);
        let at = Places { x, y, rates, sine: one, cosine: all(0.0), half: one };
        let chord = target.chord(g, x, y);
        let slope = target.chord_rates(g, &chord, &at).room.to_array();
        let room = chord.room.to_array();
        std::array::from_fn(|i| Sample { w: w[i], room: room[i], slope: slope[i] })
    }

    /// The curves on this ring; and the greatest room on it.
    pub fn sheets(&self, g: &PandaGeometry, target: &Target) -> (Sheets, f64) {
        let mut samples = SmallVec::<[Sample; 36]>::new();
        for k in (0..PARTS).step_by(4) {
            let w = [0, 1, 2, 3].map(|i| TURN * (k + i) as f64 / PARTS as f64 - PI);
            samples.extend(self.samples(g, target, w));
        }
        samples.push(Sample { w: PI, ..samples[0] });
        let mut most = samples[0];
        let mut roots = SmallVec::<[f64; 16]>::new();
        let mut stack: SmallVec<[[Sample; 2]; 96]> = samples.windows(2).map(|p| [p[0], p[1]]).collect();
        let rounding = ROOM_ROUNDING * (target.mean_x + target.mean_y);
        let mut looked = 0;
        while let Some([a, b]) = stack.pop() {
            if b.room > most.room {
                most = b;
            }
            looked += 1;
            if looked > MOST_PARTS {
                continue;
            }
            match crossing(&a, &b) {
                Crossing::None => {}
                Crossing::One => roots.push(self.root(g, target, a, b)),
                Crossing::Unclear => {
                    let m = 0.5 * (a.w + b.w);
                    let q = 0.25 * (b.w - a.w);
                    let [left, middle, right, _] = self.samples(g, target, [m - q, m, m + q, m]);
                    if b.w - a.w > ROOT_WIDTH {
                        stack.extend([[a, left], [left, middle], [middle, right], [right, b]]);
                    } else if (a.room > 0.0) != (b.room > 0.0) {
                        roots.push(self.root(g, target, a, b));
                    }
                }
            }
        }
        if looked > MOST_PARTS && most.room <= rounding {
            // The two curves of the ring coincide all around.
            roots.clear();
        }
        roots.sort_unstable_by(f64::total_cmp);
        let ring = *self;
        if roots.is_empty() {
            let sheets = if most.room > 0.0 {
                [1.0, -1.0].into_iter().map(|sign| Sheet::Whole { ring, sign }).collect()
            } else if most.room > -rounding {
                smallvec![Sheet::Lens { ring, center: most.w, half: 0.0 }]
            } else {
                Sheets::new()
            };
            return (sheets, most.room);
        }
        let ends = |i: usize| if i + 1 < roots.len() { roots[i + 1] } else { roots[0] + TURN };
        let lens = |i: usize| {
            let (center, half) = (0.5 * (roots[i] + ends(i)), 0.5 * (ends(i) - roots[i]));
            let inside = self.samples(g, target, [center; 4])[0].room > 0.0;
            inside.then_some(Sheet::Lens { ring, center, half })
        };
        ((0..roots.len()).filter_map(lens).collect(), most.room)
    }

    /// The zero of the room between two samples of opposite signs, of which there is one.
    fn root(&self, g: &PandaGeometry, target: &Target, mut a: Sample, mut b: Sample) -> f64 {
        let rising = b.room > 0.0;
        let mut at = if a.room.abs() < b.room.abs() { a } else { b };
        for _ in 0..60 {
            let newton = at.w - at.room / at.slope;
            let w = if newton > a.w && newton < b.w { newton } else { 0.5 * (a.w + b.w) };
            if (w - at.w).abs() <= f64::EPSILON * PI || w <= a.w || w >= b.w {
                return w;
            }
            at = self.samples(g, target, [w; 4])[0];
            if (at.room > 0.0) == rising { b = at } else { a = at }
        }
        at.w
    }
}

/// What is known of the zeros between two samples.
enum Crossing {
    None,
    One,
    Unclear,
}

/// By the control points of the cubic through values and slopes, and a share of what it leaves of the trapezoid rule and of
/// the bend, see `arcs.rs`.
fn crossing(a: &Sample, b: &Sample) -> Crossing {
    let h = b.w - a.w;
    let (c, d) = (a.room + h * a.slope / 3.0, b.room - h * b.slope / 3.0);
    let (mean, bend) = (0.5 * h * (a.slope + b.slope), h * (b.slope - a.slope));
    let band = ARC_BAND * ((b.room - a.room - mean).abs() + ARC_BEND * bend.abs());
    let least = a.room.min(b.room).min(c).min(d);
    let most = a.room.max(b.room).max(c).max(d);
    if least > band || most < -band {
        return Crossing::None;
    }
    let rises = [c - a.room, d - c, b.room - d];
    let monotone = rises.iter().all(|r| *r > 0.0) || rises.iter().all(|r| *r < 0.0);
    let clear = a.room.abs() > band && b.room.abs() > band;
    if monotone && clear && (a.room > 0.0) != (b.room > 0.0) { Crossing::One } else { Crossing::Unclear }
}

impl Sheet {
    /// The places at four values of u.
    #[inline(always)]
    pub fn at(&self, u: f64x4) -> Places {
        match self {
            Self::Lens { ring, center, half } => {
                let (sine, cosine) = u.sin_cos();
                let (x, y, rates) = ring.at(all(*center) - all(*half) * cosine);
                Places { x, y, rates, sine, cosine: cosine.abs(), half: all(*half) }
            }
            Self::Whole { ring, sign } => {
                let (x, y, rates) = ring.at(u);
                let sign = all(*sign);
                Places { x, y, rates, sine: sign, cosine: all(0.0), half: sign }
            }
        }
    }
}
