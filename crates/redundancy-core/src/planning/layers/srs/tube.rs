//! Refinement of a line of the grid: dynamic programming in a shrinking tube around it.

use super::problem::{SwivelLine, SwivelProblem};
use crate::joint_space::{TURN, nearest, nearest_all};
use crate::kinematics::Scratch;
use crate::parallel::prelude::*;

/// Most passes in the tube around the chosen line while it still travels, and in all.
const TUBE_TRAVELS: usize = 40;
const TUBE_PASSES: usize = 60;
/// Spacing of the swivels in the tube (rad) from which Newton's method goes on.
const TUBE_SPACING: f64 = 1e-3;
/// Swivels across the tube, odd.
const TUBE_WIDTH: usize = 9;
/// The middle of the tube.
const TUBE_MIDDLE: usize = TUBE_WIDTH / 2;

/// Positions across the tube over one point and what they cost; none where a limit is broken.
type TubeRow = [Option<([f64; 7], f64)>; TUBE_WIDTH];

/// A pass through the tube.
struct Tube {
    /// Between neighbouring swivels, rad.
    spacing: f64,
    rows: Vec<TubeRow>,
    /// The points in the order in which they are passed; the point at the cut of a closed line comes twice.
    order: Vec<usize>,
    /// Whether the line is closed.
    ring: bool,
}

/// The cheapest way through a tube: its end, and where each state came from.
struct TubeWay {
    end: usize,
    came: Vec<[usize; TUBE_WIDTH]>,
}

impl Tube {
    fn offset(&self, j: usize) -> f64 {
        self.spacing * (j as f64 - TUBE_MIDDLE as f64)
    }
}

fn cheapest(cost: &[f64; TUBE_WIDTH]) -> usize {
    (0..TUBE_WIDTH).min_by(|a, b| cost[*a].total_cmp(&cost[*b])).unwrap_or(0)
}

impl SwivelProblem<'_> {
    /// Dynamic programming in a tube around the line, which shrinks. The ends of a closed line stay where they are; it is
    /// cut open elsewhere in every other pass. `whole`: between its points it must be clear of obstacles too.
    pub fn smooth(&self, mut line: SwivelLine, whole: bool) -> SwivelLine {
        let ring = self.settings.cyclic && line.reconfigurations.is_empty();
        let mut spacing = TURN / self.settings.swivels as f64 / 2.0;
        for pass in 0..TUBE_PASSES {
            let tube = self.tube(&line, spacing, ring, pass % 2 == 1);
            let Some(way) = self.way_through(&tube, &line.reconfigurations) else { return line };
            let kept = if whole && self.obstacles.is_some() { Some(line.clone()) } else { None };
            let mut edge = follow_way(&mut line, &tube, &way);
            if let Some(kept) = kept.filter(|_| !self.touching(&line).is_empty()) {
                (line, edge) = (kept, false);
            }
            // The line wants to leave the tube: follow it before narrowing.
            spacing *= if edge && pass < TUBE_TRAVELS { 1.0 } else { 0.5 };
            if spacing < TUBE_SPACING {
                break;
            }
        }
        line
    }

    /// The tube around a line; `turned`: a closed line is cut open in its middle.
    fn tube(&self, line: &SwivelLine, spacing: f64, ring: bool, turned: bool) -> Tube {
        let n = line.q.len();
        // A closed line has its first point again as its last.
        let points = if ring { n - 1 } else { n };
        let cut = if ring && turned { points / 2 } else { 0 };
        let order = if ring { (cut..=cut + points).map(|k| k % points).collect() } else { (0..n).collect() };
        let mut tube = Tube { spacing, rows: Vec::new(), order, ring };
        let init = || Scratch::new(self.arm.chain());
        let row = |scratch: &mut Scratch, k: usize| -> TubeRow {
            std::array::from_fn(|j| {
                let s = line.swivel[k] + tube.offset(j);
                let q = self.circles[k].branch_of(s, line.branch[k]);
                let q = nearest_all(&q, &line.q[k]);
                if !(0..7).all(|i| q[i] >= self.lower[i] && q[i] <= self.upper[i]) {
                    return None;
                }
                let distance = self.distance(k, line.branch[k], s, &q);
                let place = self.place_cost(&q, distance, scratch)?;
                Some((q, self.node_cost(k, &q, s, place)))
            })
        };
        let rows = (0..points).into_par_iter().map_init(init, row).collect();
        tube.rows = rows;
        tube
    }

    /// The cheapest way through a tube; none where no state of the last point is reached.
    fn way_through(&self, tube: &Tube, reconfigurations: &[usize]) -> Option<TubeWay> {
        let mut cost = [f64::INFINITY; TUBE_WIDTH];
        let mut came: Vec<[usize; TUBE_WIDTH]> = Vec::with_capacity(tube.order.len());
        for (at, &k) in tube.order.iter().enumerate() {
            let mut next = [f64::INFINITY; TUBE_WIDTH];
            let mut from = [0; TUBE_WIDTH];
            let least = cheapest(&cost);
            let fresh = at == 0 || reconfigurations.binary_search(&k).is_ok();
            let tied = tube.ring && (at == 0 || at + 1 == tube.order.len());
            for j in 0..TUBE_WIDTH {
                if tied && j != TUBE_MIDDLE {
                    continue;
                }
                let Some((q, place)) = &tube.rows[k][j] else { continue };
                if fresh {
                    (next[j], from[j]) = (if at == 0 { 0.0 } else { cost[least] }, least);
                } else {
                    let before = tube.order[at - 1];
                    for i in 0..TUBE_WIDTH {
                        let start = tube.rows[before][i].as_ref();
                        if let Some(step) = start.and_then(|(p, _)| self.step_cost(before, p, q)) {
                            let total = cost[i] + step;
                            if total < next[j] {
                                (next[j], from[j]) = (total, i);
                            }
                        }
                    }
                }
                next[j] += place;
            }
            came.push(from);
            cost = next;
        }
        let end = cheapest(&cost);
        cost[end].is_finite().then_some(TubeWay { end, came })
    }
}

/// Moves a line to a way through the tube around it; whether the way touches the rim of the tube.
fn follow_way(line: &mut SwivelLine, tube: &Tube, way: &TubeWay) -> bool {
    let (mut j, mut edge) = (way.end, false);
    for (at, &k) in tube.order.iter().enumerate().rev() {
        if let Some((q, _)) = tube.rows[k][j] {
            line.q[k] = q;
            // The point at the cut comes twice, both times in the middle of the tube.
            if !(tube.ring && at + 1 == tube.order.len()) {
                line.swivel[k] += tube.offset(j);
            }
            edge |= j == 0 || j == TUBE_WIDTH - 1;
        }
        j = way.came[at][j];
    }
    if tube.ring {
        let points = tube.rows.len();
        line.swivel[points] = nearest(line.swivel[0], line.swivel[points]);
        line.q[points] = line.q[0];
    }
    edge
}
