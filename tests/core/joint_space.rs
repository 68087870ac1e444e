//! Windings: against sums over many turns, at exactly half a turn, at limits, without limits and without width.

use std::f64::consts::{PI, TAU};

use proptest::prelude::*;
use redundancy_core::joint_space::*;

const INF: f64 = f64::INFINITY;
const SLACK: f64 = redundancy_core::tolerance::LIMIT_SLACK;

/// Windings of `q` by brute force, far beyond what the tests use.
fn all(q: f64) -> impl Iterator<Item = f64> {
    (-40..=40).map(move |k| q + TAU * f64::from(k))
}

fn closest(q: f64, to: f64) -> f64 {
    all(q).min_by(|a, b| (a - to).abs().total_cmp(&(b - to).abs())).unwrap()
}

fn angle() -> impl Strategy<Value = f64> {
    // Multiples of half a turn, and everything else.
    prop_oneof![
        -60.0..60.0,
        (-16..16).prop_map(|k| PI * f64::from(k)),
        (-16..16).prop_map(|k| (PI * f64::from(k)).next_up())
    ]
}

fn limits() -> impl Strategy<Value = (f64, f64)> {
    let width = prop_oneof![Just(0.0), 0.0..1.0, 0.0..20.0, Just(TAU), Just(PI)];
    (-15.0..15.0, width).prop_map(|(lower, width)| (lower, lower + width))
}

proptest! {
    #[test]
    fn wrapped_angles_are_principal_and_the_same_position(q in angle()) {
        let w = wrap(q);
        prop_assert!(w > -PI && w <= PI, "{w}");
        prop_assert!((w.sin() - q.sin()).abs() < 1e-13 && (w.cos() - q.cos()).abs() < 1e-13);
        prop_assert_eq!(wrap(w), w);
        prop_assert_eq!(turns(q).fract(), 0.0);
        prop_assert!((q - shift(q) - w).abs() < 1e-14 || (q - shift(q) - w).abs() > 6.0);
    }

    #[test]
    fn sums_and_opposites_agree_with_wrap(a in angle(), b in angle()) {
        let (a, b) = (wrap(a), wrap(b));
        let gap = (wrap_sum(a + b) - wrap(a + b)).abs();
        prop_assert!(gap < 1e-14 || (gap - TAU).abs() < 1e-14);
        prop_assert!(wrap_sum(a + b) > -PI - 1e-15 && wrap_sum(a + b) <= PI);
        let o = opposite(a);
        prop_assert!(o > -PI - 1e-15 && o <= PI);
        prop_assert!((o.cos() + a.cos()).abs() < 1e-14 && (o.sin() + a.sin()).abs() < 1e-14);
    }

    #[test]
    fn differences_lead_there_the_short_way(a in angle(), b in angle()) {
        let d = difference(a, b);
        prop_assert!(d > -PI && d <= PI);
        prop_assert!(((a + d).cos() - b.cos()).abs() < 1e-12 && ((a + d).sin() - b.sin()).abs() < 1e-12);
        prop_assert!(d.abs() <= (closest(b, a) - a).abs() + 1e-12);
        prop_assert!((most_apart(&[a, 0.0], &[b, 0.0]) - d.abs()).abs() < 1e-15);
        prop_assert!((turns_over(wrap(b) - wrap(a)) as f64 - turns(wrap(b) - wrap(a))).abs() == 0.0 || (d.abs() - PI).abs() < 1e-12);
    }

    #[test]
    fn nearest_is_the_nearest_of_all(q in angle(), reference in angle()) {
        let w = nearest(q, reference);
        prop_assert!(((w - reference).abs() - (closest(q, reference) - reference).abs()).abs() < 1e-12);
        prop_assert!(((w - q) / TAU - ((w - q) / TAU).round()).abs() < 1e-13);
        let mut row = [q, reference];
        nearest_row(&mut row, &[reference; 2]);
        prop_assert_eq!(row, nearest_all(&[q, reference], &[reference; 2]));
        prop_assert_eq!(row, [w, reference]);
    }

    #[test]
    fn windings_within_limits(q in angle(), reference in angle(), (lower, upper) in limits()) {
        // A winding that is at a limit up to rounding may count either way.
        let edge = all(q).any(|w| (w - lower).abs() < 1e-11 || (w - upper).abs() < 1e-11);
        let inside: Vec<f64> = all(q).filter(|w| *w >= lower && *w <= upper).collect();
        let least = |to: f64| inside.iter().map(|w| (w - to).abs()).fold(INF, f64::min);
        for (found, to) in [(within(q, lower, upper), q), (nearest_within(q, reference, lower, upper), reference)] {
            if let Some(w) = found {
                prop_assert!(w >= lower && w <= upper);
                prop_assert!(edge || ((w - to).abs() - least(to)).abs() < 1e-11, "{w} {to} {inside:?}");
            } else {
                prop_assert!(edge || inside.is_empty());
            }
        }
        if !edge {
            let found: Vec<f64> = windings(q, lower, upper).collect();
            prop_assert_eq!(found.len(), inside.len());
            prop_assert!(found.iter().zip(&inside).all(|(a, b)| (a - b).abs() < 1e-12));
            prop_assert_eq!(holds(q, lower, upper), !inside.is_empty());
            let wound = wind_into(q, lower, upper);
            let right = if inside.is_empty() { wound == q } else { ((wound - q).abs() - least(q)).abs() < 1e-11 };
            prop_assert!(right);
            let [first, last] = turns_within([q, q], lower, upper);
            prop_assert_eq!((last - first + 1.0).max(0.0), inside.len() as f64);
        }
        let miss = all(q).map(|w| (lower - w).max(w - upper).max(0.0)).fold(INF, f64::min);
        prop_assert!((outside(q, lower, upper) - miss).abs() < 1e-12);
        let room = all(q).map(|w| (w - lower).min(upper - w)).fold(-INF, f64::max);
        prop_assert!((margin(q, lower, upper) - room).abs() < 1e-12);
    }

    #[test]
    fn one_limit_only(q in angle(), limit in -15.0..15.0) {
        for (lower, upper) in [(limit, INF), (-INF, limit)] {
            let w = within(q, lower, upper).unwrap();
            prop_assert!(w >= lower && w <= upper);
            prop_assert!(wind_into(q, lower, upper) >= lower - 1e-12 && wind_into(q, lower, upper) <= upper + 1e-12);
            prop_assert_eq!(outside(q, lower, upper), 0.0);
            prop_assert_eq!(margin(q, lower, upper), INF);
            prop_assert!(holds(q, lower, upper));
            let found: Vec<f64> = windings(q, lower, upper).collect();
            prop_assert!(found.len() <= 1 && found.iter().all(|w| (w - limit).abs() <= TAU + 1e-12));
        }
        prop_assert_eq!(within(q, -INF, INF), Some(q));
        prop_assert_eq!(wind_into(q, -INF, INF), q);
        prop_assert_eq!(outside(q, -INF, INF), 0.0);
        prop_assert!(holds(q, -INF, INF));
        let found: Vec<f64> = windings(q, -INF, INF).collect();
        prop_assert!(found.len() == 1 && (found[0] - wrap(q)).abs() < 1e-13);
    }

    /// The nearest winding of a range of angles: no angle of it has a winding that is nearer than promised.
    #[test]
    fn spans(low in angle(), width in 0.0..3.0, center in angle(), (lower, upper) in limits()) {
        let high = low + width;
        let some = nearest_span([low, high], center, lower, upper);
        let samples = (0..=60).map(|k| low + width * f64::from(k) / 60.0);
        let inside = samples.flat_map(|q| all(q).filter(|w| *w >= lower && *w <= upper).map(move |w| (q, w)));
        let mut best = INF;
        let mut others = false;
        for (q, w) in inside {
            best = best.min((w - center).abs());
            let nearest = all(q).filter(|w| *w >= lower && *w <= upper).map(|w| (w - center).abs()).fold(INF, f64::min);
            others |= some.is_some_and(|span| (w - q - span.shift).abs() > 1.0 && (w - center).abs() < nearest + 1e-12);
        }
        if let Some(span) = some {
            prop_assert!(span.distance <= best + 1e-12);
            prop_assert!(best == INF || best - span.distance < width / 60.0 + 1e-9 || upper - lower < 0.1);
            prop_assert!(!(span.unique && others) || (best - span.distance).abs() < 1e-12);
        } else {
            prop_assert_eq!(best, INF);
        }
    }

    #[test]
    fn lines_are_shifted_into_limits(least in angle(), width in 0.0..4.0, (lower, upper) in limits()) {
        let (shift, fits) = shift_within([least, least + width], lower, upper);
        prop_assert!((turns(shift) * TAU - shift).abs() < 1e-12);
        let some = |slack: f64| all(least).any(|w| w >= lower + slack && w + width <= upper - slack);
        if fits {
            prop_assert!(least + shift >= lower && least + width + shift <= upper);
        } else {
            prop_assert!(!some(1e-11));
        }
    }

    #[test]
    fn monotone_joints_keep_their_direction(start in angle(), step in 1e-5_f64..6.2, back: bool, k in -3..3) {
        let step = if back { -step } else { step };
        let end = start + step + TAU * f64::from(k);
        prop_assert!((monotone(start, end, step.signum()) - (start + step)).abs() < 1e-11);
    }

    #[test]
    fn other_periods(value in -40.0..40.0, period in 0.5..20.0) {
        let w = wrap_over(value, period);
        prop_assert!(w > -0.5 * period - 1e-14 && w <= 0.5 * period + 1e-14);
        prop_assert!(((value - w) / period - ((value - w) / period).round()).abs() < 1e-12);
        let other = other_way(w, period);
        prop_assert!((other - w).abs() == period || ((other - w).abs() - period).abs() < 1e-14);
        prop_assert!(other == 0.0 || w == 0.0 || other.signum() != w.signum());
    }
}

#[test]
fn exactly_half_a_turn() {
    for k in -5..=5 {
        let q = PI + TAU * f64::from(k);
        assert!((wrap(q) - PI).abs() < 1e-14 || (wrap(q) + PI).abs() < 1e-14);
        assert!(wrap(q) > -PI && wrap(q) <= PI);
    }
    assert_eq!([wrap(PI), wrap(-PI), wrap(PI.next_up()), wrap(0.0)], [PI, PI, wrap(PI.next_up()), 0.0]);
    assert!(wrap(PI.next_up()) <= PI && wrap((-PI).next_down()) > -PI);
    assert_eq!([wrap_sum(PI), wrap_sum(-PI), wrap_sum(TAU)], [PI, PI, 0.0]);
    assert_eq!([opposite(0.0), opposite(PI), opposite(-0.5)], [PI, 0.0, PI - 0.5]);
    assert_eq!([difference(0.0, PI), difference(PI, 0.0), difference(0.0, -PI)], [PI; 3]);
    // Half a turn away an angle keeps its winding.
    assert_eq!(
        [nearest(PI, 0.0), nearest(-PI, 0.0), nearest(0.0, PI), nearest(0.0, -PI)],
        [PI, -PI, 0.0, 0.0]
    );
    assert_eq!([turns_over(PI), turns_over(-PI), turns_over(4.0), turns_over(-4.0)], [0, 0, 1, -1]);
    assert_eq!([wrap_over(TAU, 2.0 * TAU), wrap_over(-TAU, 2.0 * TAU)], [TAU, TAU]);
}

#[test]
fn at_limits_and_without_width() {
    // At a limit, with the slack beside it, and not beyond.
    assert_eq!(within(1.0 + 0.9 * SLACK, -1.0, 1.0), Some(1.0));
    assert_eq!(within(-1.0 - 0.9 * SLACK, -1.0, 1.0), Some(-1.0));
    assert_eq!(within(1.0 + 3.0 * SLACK, -1.0, 1.0), None);
    assert_eq!(within(1.0, 1.0, 1.0), Some(1.0));
    assert_eq!(within(1.0 - TAU, 1.0, 1.0), Some(1.0));
    assert_eq!(within(1.1, 1.0, 1.0), None);
    assert_eq!(nearest_within(-PI, 9.0, PI, PI), Some(PI));
    assert_eq!([wind_into(2.0, 2.0, 2.0), wind_into(2.1, 2.0, 2.0)], [2.0, 2.1]);
    assert!((outside(1.5, 1.0, 1.0) - 0.5).abs() < 1e-15 && (outside(1.0 + PI, 1.0, 1.0) - PI).abs() < 1e-15);
    assert!((margin(1.5, 1.0, 1.0) + 0.5).abs() < 1e-15);
    assert!(holds(1.0, 1.0, 1.0) && !holds(1.5, 1.0, 1.0));
    assert_eq!(windings(1.0, 1.0, 1.0).collect::<Vec<_>>(), [1.0]);
    // A whole turn wide: both ends are the same position.
    assert_eq!(windings(-PI, -PI, PI).count(), 2);
    assert_eq!(within(PI + 0.5, -PI, PI).map(|w| (w + PI - 0.5).abs() < 1e-15), Some(true));
    assert_eq!(around(&[0.5, 1.5], 5), 1.5 + 2.0 * TAU);
    assert!(around(&[], 3).is_nan());
}

#[test]
fn not_a_number_is_not_an_angle() {
    let nan = f64::NAN;
    assert!(
        turns(nan).is_nan()
            && wrap(nan).is_nan()
            && nearest(0.0, nan).is_nan()
            && difference(nan, 0.0).is_nan()
    );
    assert_eq!(within(nan, -1.0, 1.0), None);
    assert!(!holds(nan, -1.0, 1.0));
    assert_eq!(windings(nan, -1.0, 1.0).count() + windings(nan, -INF, INF).count(), 0);
    // Beyond 2^31 turns nothing is promised but a finite answer.
    assert!(turns(1e300).is_finite() && nearest(0.0, -1e300).is_finite());
}

/// Elsewhere whole turns are neither added nor removed. A turn as a length (of a circle, of a grid over it) is `joint_space::TURN`.
#[test]
fn whole_turns_are_added_here_alone() {
    // Formulas in which 2 pi is no turn of a joint: circumferences, a sine of a share.
    const FORMULAS: [&str; 3] = ["path/shapes.rs", "velocity/damping.rs", "optimum/follow.rs"];
    // Left of this room.
    const LEFT: [&str; 2] = ["rotation/", "joint_space/"];
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![root.clone()];
    let mut files = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = entry.strip_prefix(&root).unwrap().to_string_lossy().replace('\\', "/");
            if entry.is_dir() {
                folders.push(entry);
            } else if !LEFT.iter().any(|room| name.starts_with(room)) && !FORMULAS.contains(&name.as_str()) {
                files += 1;
                for (k, line) in std::fs::read_to_string(&entry).unwrap().lines().enumerate() {
                    let code = line.split("//").next().unwrap_or_default();
                    let turns =
                        ["TAU", "2.0 * PI", "2.0 * std::f64::consts::PI", "rem_euclid(TURN", "/ TURN).round"];
                    assert!(!turns.iter().any(|turn| code.contains(turn)), "{name}:{}: {line}", k + 1);
                }
            }
        }
    }
    assert!(files > 100);
}
