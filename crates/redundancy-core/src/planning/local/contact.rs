//! Contact along the rows of a run: in them, and between them when the joints go straight.

use crate::kinematics::{Kinematics, Scratch};
use crate::scene::{Contact, Proximity, ProximityMemory, Surroundings, SweepMemory, Thing, Visitor, sweep};

/// Watches the distances of a run.
pub(super) struct ContactWatch<'a> {
    around: &'a Surroundings,
    scratch: Scratch,
    memory: ProximityMemory,
    sweeps: SweepMemory,
    /// Distances from obstacles, and of links from each other, of each row, m.
    pub rows: Vec<[f64; 2]>,
    before: Option<(Vec<f64>, f64)>,
    /// What touched in the row before.
    touching: Option<(Thing, Thing)>,
    /// The first contact.
    pub first: Option<String>,
}

/// The nearest pairs of two kinds: with an obstacle, and of two links.
struct Both {
    distance: [f64; 2],
    pairs: [Option<(Thing, Thing)>; 2],
}

impl Both {
    fn place(first: Thing, second: Thing) -> usize {
        usize::from(matches!((first, second), (Thing::Link(_), Thing::Link(_))))
    }
}

impl Visitor for Both {
    fn limit(&self, first: Thing, second: Thing) -> f64 {
        self.distance[Self::place(first, second)]
    }

    fn found(&mut self, contact: &Contact<'_>) -> bool {
        let place = Self::place(contact.first, contact.second);
        self.distance[place] = contact.gap.distance;
        self.pairs[place] = Some((contact.first, contact.second));
        true
    }
}

impl<'a> ContactWatch<'a> {
    pub fn new(around: &'a Surroundings) -> Self {
        let chain = around.chain();
        Self {
            around,
            scratch: Scratch::new(chain),
            memory: ProximityMemory::new(),
            sweeps: SweepMemory::new(chain),
            rows: Vec::new(),
            before: None,
            touching: None,
            first: None,
        }
    }

    fn names(&self, (first, second): (Thing, Thing)) -> String {
        format!("'{}' and '{}'", self.around.name(first), self.around.name(second))
    }

    /// Looks at a row, and at the way to it; the message of an event where contact begins.
    pub fn see(&mut self, q: &[f64], t: f64) -> Option<String> {
        let kinematics: Kinematics<'_> = self.around.chain().kinematics_unchecked(q, &mut self.scratch);
        let mut both = Both { distance: [f64::INFINITY; 2], pairs: [None; 2] };
        self.around.scan(&kinematics, t, &mut self.memory, &mut both);
        self.rows.push(both.distance);
        let least = usize::from(both.distance[1] < both.distance[0]);
        let pair = both.pairs[least].filter(|_| both.distance[least] < 0.0);
        let mut message = None;
        if let Some(pair) = pair.filter(|pair| self.touching != Some(*pair)) {
            let depth = -1e3 * both.distance[least];
            message = Some(format!("{} touch, {depth:.3} mm deep, at t = {t:.3} s", self.names(pair)));
        }
        if pair.is_none()
            && self.touching.is_none()
            && let Some((before, earlier)) = &self.before
            && let Some(hit) = sweep(self.around, [before, q], [*earlier, t], 0.0, &mut self.sweeps)
        {
            let at = earlier + hit.at * (t - earlier);
            message = Some(format!("{} touch at t = {at:.4} s", self.names((hit.first, hit.second))));
        }
        if self.first.is_none() {
            self.first.clone_from(&message);
        }
        self.touching = pair;
        self.before = Some((q.to_vec(), t));
        message
    }
}
