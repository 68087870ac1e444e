//! How far an S-R-S arm is from obstacles, and from itself, as a function of its swivel.
//!
//! Clearance counts per link. What the swivel cannot move (see [`split_by_freedom`]) neither hides nor shifts the rest: it is
//! kept apart, as `held`, and only reported. Of the rest each link has its own nearest pair; contact of any is forbidden, and
//! what each misses of the wanted clearance is added up.
//!
//! Over one pose only the elbow moves: on its circle, the same for all branches of an arm without elbow offset. Where links
//! are capsules from joint to joint and the joints' frames lie on the lines shoulder - elbow - wrist (they do on arms as
//! they are built) the moving links are two segments. Obstacles that both segments stay clear of for every swivel are
//! dropped once per pose. Other bodies take the kinematics of each configuration.

use std::cell::RefCell;

use nalgebra::Vector3;

use super::anchor::{Anchor, Groups, Known, NearScan};
use super::near::Near;
use crate::error::Result;
use crate::kinematics::{Scratch, Task};
use crate::pose::Pose;
use crate::scene::{
    Contact, LinkGeometry, Nearby, Proximity, Scene, SegmentObstacles, Sphere, Surroundings, SweepMemory,
    Thing, Visitor, segment_distance, split_by_freedom, sweep, with_memory,
};
use crate::solutions::{SelfMotion, SrsArm};
use crate::tolerance::ON_LINE;

/// What an arm keeps a distance from.
#[derive(Debug, Clone, Copy)]
pub(in crate::planning) struct Around<'a> {
    /// `None`: capsules of `link_radius` from joint to joint.
    pub links: Option<&'a LinkGeometry>,
    pub link_radius: f64,
    pub scene: Option<&'a Scene>,
    pub self_collision: bool,
}

impl Around<'_> {
    fn geometry(&self, arm: &SrsArm) -> Result<LinkGeometry> {
        let geometry = match self.links {
            Some(links) => links.clone(),
            None => LinkGeometry::joint_to_joint(arm.chain(), self.link_radius)?,
        };
        // Pairs of capsules are looked for only where they are asked for.
        if self.self_collision && self.links.is_none() {
            return geometry.with_capsule_pairs(arm.chain());
        }
        Ok(geometry)
    }

    fn is_plain(&self) -> bool {
        let fixed = |scene: &Scene| {
            scene.allowed().is_empty() && scene.obstacles().iter().all(|o| o.attached_to.is_none())
        };
        self.links.is_none() && !self.self_collision && self.scene.is_some_and(fixed)
    }
}

/// The links of an arm beside what they must not touch.
#[derive(Debug, Clone)]
pub(in crate::planning) struct ArmClearance {
    arm: SrsArm,
    /// Pairs that the swivel changes, and those that the pose holds.
    pub moved: Surroundings,
    pub held: Surroundings,
    /// What a point of the arm moves at most per joint, of those that count.
    reach: Vec<f64>,
    /// Speed of the fastest obstacle, m/s.
    fastest: f64,
    groups: Groups,
    plain: Option<Plain>,
}

/// Two segments for the moving links.
#[derive(Debug, Clone)]
struct Plain {
    obstacles: SegmentObstacles,
    radius: f64,
    lengths: [f64; 2],
}

/// An arm over one pose at one time.
#[derive(Debug, Clone)]
pub(in crate::planning) struct OverPose {
    shoulder: Vector3<f64>,
    wrist: Vector3<f64>,
    /// Obstacles that the upper arm may come near to, and those of the forearm.
    upper: Vec<u32>,
    fore: Vec<u32>,
    beyond: f64,
    t: f64,
}

/// A distance and how it changes.
#[derive(Debug, Clone, Copy)]
pub(in crate::planning) struct Rates {
    pub distance: f64,
    /// Per rad of swivel, m.
    pub by_swivel: f64,
    /// Per second, m/s, from the motion of the obstacle.
    pub by_time: f64,
}

impl Rates {
    const FAR: Self = Self { distance: f64::INFINITY, by_swivel: 0.0, by_time: 0.0 };
}

/// An arm over one pose at one time, for distances with their rates.
pub(in crate::planning) struct Now<'a> {
    near: &'a ArmClearance,
    t: f64,
    shoulder: Vector3<f64>,
    wrist: Vector3<f64>,
}

thread_local! {
    static SCRATCH: RefCell<Option<Scratch>> = const { RefCell::new(None) };
}

/// Calls `work` with kinematic memory that this thread keeps.
fn with_scratch<T>(arm: &SrsArm, work: impl FnOnce(&mut Scratch) -> T) -> T {
    SCRATCH.with(|scratch| match scratch.try_borrow_mut() {
        Ok(mut scratch) => work(scratch.get_or_insert_with(|| Scratch::new(arm.chain()))),
        Err(_) => work(&mut Scratch::new(arm.chain())),
    })
}

impl Now<'_> {
    /// Distance of the nearest moving link, its derivatives by the swivel and by the time (obstacles move, the arm stands).
    pub fn rates(&self, motion: &SelfMotion, u: [f64; 2], branch: usize) -> Rates {
        let Some(plain) = &self.near.plain else {
            return self.near.rates_by_kinematics(motion, self.t, u, branch);
        };
        let (elbow, rate) = (motion.elbow(u), motion.elbow_rate(u));
        let mut least = Rates::FAR;
        // The elbow is the end of the two links that move.
        for start in [self.shoulder, self.wrist] {
            let reach = least.distance + plain.radius;
            let Some((near, velocity)) = plain.obstacles.nearest(&start, &elbow, self.t, reach) else {
                continue;
            };
            least = Rates {
                distance: near.distance - plain.radius,
                by_swivel: near.gradient.dot(&rate) * near.share,
                by_time: -near.gradient.dot(&velocity),
            };
        }
        least
    }
}

impl ArmClearance {
    pub fn new(arm: &SrsArm, around: &Around<'_>) -> Result<Self> {
        let geometry = around.geometry(arm)?;
        let all = Surroundings::new(arm.chain(), &geometry, around.scene, around.self_collision)?;
        let (moved, held) = split_by_freedom(&all, &Task::POSE);
        let plain = match around.scene.filter(|_| around.is_plain()) {
            Some(scene) if is_plain(arm)? => Some(Plain {
                obstacles: SegmentObstacles::new(scene),
                radius: around.link_radius,
                lengths: arm.lengths(),
            }),
            _ => None,
        };
        let obstacles = around.scene.map(Scene::obstacles).unwrap_or_default();
        let fastest = obstacles.iter().map(|o| o.velocity.norm()).fold(0.0, f64::max);
        let reach = moved.reach();
        let groups = Groups::new(&moved);
        Ok(Self { arm: arm.clone(), moved, held, reach, fastest, groups, plain })
    }

    /// True where nothing is to be kept away from.
    pub fn is_empty(&self) -> bool {
        self.moved.is_empty() && self.held.is_empty()
    }

    /// Prepares a pose; distances beyond `beyond` need not be exact. `None` where the two links are not plain.
    pub fn over(&self, pose: &Pose, t: f64, beyond: f64) -> Option<OverPose> {
        let plain = self.plain.as_ref()?;
        let shoulder = self.arm.shoulder();
        let wrist = pose.rotation * self.arm.wrist_in_tool() + pose.translation.vector;
        let [upper, fore] = [(shoulder, plain.lengths[0]), (wrist, plain.lengths[1])]
            .map(|(from, length)| plain.obstacles.within(&from, length + plain.radius + beyond, t));
        Some(OverPose { shoulder, wrist, upper, fore, beyond, t })
    }

    /// Over a prepared pose with the elbow at a point of the world.
    #[inline]
    fn at_elbow(&self, plain: &Plain, over: &OverPose, elbow: &Vector3<f64>, wanted: f64) -> Near {
        let links = [(&over.shoulder, &over.upper), (&over.wrist, &over.fore)];
        let distances = links.map(|(from, list)| {
            let far = over.beyond + plain.radius;
            plain.obstacles.least(from, elbow, over.t, list, far) - plain.radius
        });
        Near::of(distances, wanted)
    }

    /// Prepares a pose at time `t` for [`Now::rates`].
    pub fn now<'a>(&'a self, pose: &Pose, t: f64) -> Now<'a> {
        let wrist = pose.rotation * self.arm.wrist_in_tool() + pose.translation.vector;
        Now { near: self, t, shoulder: self.arm.shoulder(), wrist }
    }

    fn rates_by_kinematics(&self, motion: &SelfMotion, t: f64, u: [f64; 2], branch: usize) -> Rates {
        struct Nearest<'a, 'k> {
            kinematics: &'a crate::kinematics::Kinematics<'k>,
            rates: &'a [f64; 7],
            least: Rates,
        }
        impl Visitor for Nearest<'_, '_> {
            fn limit(&self, _: Thing, _: Thing) -> f64 {
                self.least.distance
            }

            fn found(&mut self, contact: &Contact<'_>) -> bool {
                let mut gradient = [0.0; 7];
                contact.add_gradient(self.kinematics, 1.0, &mut gradient);
                self.least = Rates {
                    distance: contact.gap.distance,
                    by_swivel: gradient.iter().zip(self.rates).map(|(g, r)| g * r).sum(),
                    by_time: contact.by_time(),
                };
                true
            }
        }
        let (q, rates) = motion.branch_with_rates(u, branch);
        with_scratch(&self.arm, |scratch| {
            let kinematics = self.arm.chain().kinematics_unchecked(&q, scratch);
            let mut nearest = Nearest { kinematics: &kinematics, rates: &rates, least: Rates::FAR };
            with_memory(|memory| self.moved.scan(&kinematics, t, memory, &mut nearest));
            nearest.least
        })
    }

    /// Distances at a branch's configuration over a pose; beyond `beyond` they are not exact. The anchor is of the same pose and
    /// time, or none; another one may take its place.
    fn by_kinematics(
        &self,
        (branch, s, q): (usize, f64, &[f64; 7]),
        t: f64,
        (wanted, beyond): (f64, f64),
        anchor: &mut Option<Anchor>,
    ) -> Near {
        let known = anchor.as_ref().map_or(Known::Little, |anchor| anchor.says((branch, s, q), beyond));
        let mut scan = match known {
            Known::Far => return Near { least: beyond, missing: 0.0 },
            Known::Some(open) => NearScan::of(&self.groups, open, beyond),
            Known::Little => NearScan::for_anchor(&self.groups, beyond),
        };
        with_scratch(&self.arm, |scratch| {
            let kinematics = self.arm.chain().kinematics_unchecked(q, scratch);
            with_memory(|memory| self.moved.scan(&kinematics, t, memory, &mut scan));
            if matches!(known, Known::Little) && scan.is_whole() {
                let pose = kinematics.pose();
                let wrist = pose.rotation * self.arm.wrist_in_tool() + pose.translation.vector;
                let ends = [&self.arm.shoulder(), &wrist];
                *anchor = Some(Anchor::new((branch, s, q), &scan, &kinematics, &self.moved, ends));
            }
        });
        scan.near(wanted)
    }

    /// The nearest pair at a configuration: of what the swivel moves, and of what the pose holds.
    pub fn nearest(&self, q: &[f64], t: f64) -> [Option<Nearby>; 2] {
        with_scratch(&self.arm, |scratch| {
            let kinematics = self.arm.chain().kinematics_unchecked(q, scratch);
            let of = |part: &Surroundings| {
                with_memory(|memory| part.nearest(&kinematics, t, f64::INFINITY, memory))
            };
            [of(&self.moved), of(&self.held)]
        })
    }

    /// Whether obstacles, and links against each other, are checked.
    pub fn looks_at(&self) -> [bool; 2] {
        let own = |pair: &(Thing, Thing)| matches!(pair, (Thing::Link(_), Thing::Link(_)));
        let pairs: Vec<(Thing, Thing)> = self.moved.pairs().into_iter().chain(self.held.pairs()).collect();
        [pairs.iter().any(|pair| !own(pair)), pairs.iter().any(own)]
    }

    /// Distances at a configuration from the obstacles, and of links from each other.
    pub fn row(&self, q: &[f64], t: f64) -> [f64; 2] {
        struct Two([f64; 2]);
        impl Two {
            fn place(first: Thing, second: Thing) -> usize {
                usize::from(matches!((first, second), (Thing::Link(_), Thing::Link(_))))
            }
        }
        impl Visitor for Two {
            fn limit(&self, first: Thing, second: Thing) -> f64 {
                self.0[Self::place(first, second)]
            }
            fn found(&mut self, contact: &Contact<'_>) -> bool {
                self.0[Self::place(contact.first, contact.second)] = contact.gap.distance;
                true
            }
        }
        with_scratch(&self.arm, |scratch| {
            let kinematics = self.arm.chain().kinematics_unchecked(q, scratch);
            let mut two = Two([f64::INFINITY; 2]);
            for part in [&self.moved, &self.held] {
                with_memory(|memory| part.scan(&kinematics, t, memory, &mut two));
            }
            two.0
        })
    }

    /// At the swivel `s` of a branch whose configuration is `q`. The anchor is of the same pose and time, or none.
    pub fn of_one(
        &self,
        motion: &SelfMotion,
        over: Option<&OverPose>,
        (branch, s, q): (usize, f64, &[f64; 7]),
        t: f64,
        (wanted, beyond): (f64, f64),
        anchor: &mut Option<Anchor>,
    ) -> Near {
        match over.zip(self.plain.as_ref()) {
            Some((over, plain)) => {
                let (sin, cos) = s.sin_cos();
                self.at_elbow(plain, over, &motion.elbow([cos, sin]), wanted)
            }
            None => self.by_kinematics((branch, s, q), t, (wanted, beyond), anchor),
        }
    }

    /// At the swivel `s` of the branches in `mask`, in branch order, with an anchor for each.
    pub fn of_branches(
        &self,
        motion: &SelfMotion,
        over: Option<&OverPose>,
        (s, q, mask): (f64, &[[f64; 7]; 8], u8),
        t: f64,
        reach: (f64, f64),
        anchors: &mut [Option<Anchor>; 8],
    ) -> [Near; 8] {
        if over.is_some() {
            return [self.of_one(motion, over, (0, s, &q[0]), t, reach, &mut None); 8];
        }
        std::array::from_fn(|b| {
            if mask & (1 << b) == 0 {
                Near::FAR
            } else {
                self.of_one(motion, over, (b, s, &q[b]), t, reach, &mut anchors[b])
            }
        })
    }

    /// Whether everything that the swivel moves stays clear while the joints go straight, with known distances at both ends.
    pub fn edge_is_clear(
        &self,
        [a, b]: [&[f64; 7]; 2],
        [start, end]: [f64; 2],
        near: [f64; 2],
        memory: &mut Option<SweepMemory>,
    ) -> bool {
        if near[0] <= 0.0 || near[1] <= 0.0 {
            return false;
        }
        let turned: f64 = self.reach.iter().enumerate().map(|(i, reach)| reach * (b[i] - a[i]).abs()).sum();
        if near[0] + near[1] > turned + self.fastest * (end - start).abs() {
            return true;
        }
        let memory = memory.get_or_insert_with(|| SweepMemory::new(self.arm.chain()));
        sweep(&self.moved, [a, b], [start, end], 0.0, memory).is_none()
    }
}

/// Whether the joints between lie on shoulder, elbow and wrist.
fn is_plain(arm: &SrsArm) -> Result<bool> {
    let chain = arm.chain();
    let mut scratch = Scratch::new(chain);
    for round in 1..4 {
        let q: [f64; 7] =
            std::array::from_fn(|i| 0.3 * (1.0 + i as f64 * 0.7 * f64::from(round)).sin() + 0.4);
        let kinematics = chain.kinematics(&q, &mut scratch)?;
        let (o, pose) = (kinematics.origins(), kinematics.pose());
        let motion = arm.self_motion(pose)?;
        let s = arm.swivel(&q)?;
        let (sin, cos) = s.sin_cos();
        let elbow = motion.elbow([cos, sin]);
        let (shoulder, wrist) =
            (arm.shoulder(), pose.rotation * arm.wrist_in_tool() + pose.translation.vector);
        let on = |x: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>| {
            segment_distance(a, b, &Sphere { center: *x, radius: 0.0 }.into()).distance < ON_LINE
        };
        let same = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm() < ON_LINE;
        let fits = same(&o[1], &shoulder)
            && on(&o[2], &shoulder, &elbow)
            && same(&o[3], &elbow)
            && on(&o[4], &elbow, &wrist)
            && same(&o[5], &wrist);
        if !fits {
            return Ok(false);
        }
    }
    Ok(true)
}
