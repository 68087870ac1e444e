//! How far an S-R-S arm is from obstacles as a function of its swivel.
//!
//! Over one pose only the elbow moves: on its circle, the same for all branches of an arm without elbow offset. Where the
//! joints' frames lie on the lines shoulder - elbow - wrist (they do on arms as they are built) the moving links are two
//! segments, and everything else is fixed by the pose. Obstacles that both segments stay clear of for every swivel are
//! dropped once per pose. Arms with frames elsewhere take the kinematics of each configuration.

use nalgebra::Vector3;

use crate::error::Result;
use crate::kinematics::Scratch;
use crate::pose::Pose;
use crate::scene::{LinkGeometry, Scene, Shape, Sphere, segment_distance};
use crate::solutions::{SelfMotion, SrsArm};
use crate::tolerance::ON_LINE;

/// The links of an arm beside a scene.
#[derive(Debug, Clone)]
pub(in crate::planning) struct ArmClearance {
    arm: SrsArm,
    pub geometry: LinkGeometry,
    radius: f64,
    lengths: [f64; 2],
    /// Joint 1 in the world and joint 7 in the tool frame, where the two moving links are plain segments.
    plain: Option<[Vector3<f64>; 2]>,
}

/// The same over one pose at one time.
#[derive(Debug, Clone)]
pub(in crate::planning) struct OverPose {
    shoulder: Vector3<f64>,
    wrist: Vector3<f64>,
    /// Obstacles that the upper arm may come near to, and those of the forearm.
    upper: Vec<Shape>,
    fore: Vec<Shape>,
    /// Distance of what the swivel does not move.
    fixed: f64,
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

/// An arm over one pose at one time, for distances with their rates.
pub(in crate::planning) struct Now<'a> {
    near: &'a ArmClearance,
    scene: &'a Scene,
    t: f64,
    shoulder: Vector3<f64>,
    wrist: Vector3<f64>,
    /// What the swivel does not move.
    fixed: Rates,
}

impl Now<'_> {
    /// Distance, its derivatives by the swivel and by the time (obstacles move, the arm stands).
    pub fn rates(&self, motion: &SelfMotion, u: [f64; 2], branch: usize) -> Rates {
        if self.near.plain.is_none() {
            return self.near.rates_by_kinematics(motion, self.scene, self.t, u, branch);
        }
        let (elbow, rate) = (motion.elbow(u), motion.elbow_rate(u));
        // The elbow is the end of the two links that move.
        self.least(self.fixed, &[(self.shoulder, elbow, 1.0), (self.wrist, elbow, 1.0)], &rate)
    }

    /// The least of `least` and the distances of links (start, end, how much of `rate` the end moves).
    #[inline(always)]
    fn least(
        &self,
        mut least: Rates,
        links: &[(Vector3<f64>, Vector3<f64>, f64)],
        rate: &Vector3<f64>,
    ) -> Rates {
        let radius = self.near.radius;
        for (obstacle, ball) in self.scene.obstacles().iter().zip(self.scene.balls()) {
            let moves = obstacle.velocity != Vector3::zeros();
            let by = if moves { obstacle.velocity * self.t } else { Vector3::zeros() };
            let moved;
            let shape = if moves {
                moved = obstacle.shape.moved(&by);
                &moved
            } else {
                &obstacle.shape
            };
            let center = ball.0 + by;
            for (start, end, share) in links {
                let half = 0.5 * (end - start).norm();
                let far = least.distance + radius + half + ball.1;
                if half == 0.0 || (0.5 * (start + end) - center).norm_squared() > far * far && far > 0.0 {
                    continue;
                }
                let near = segment_distance(start, end, shape);
                let distance = near.distance - radius;
                if distance < least.distance {
                    least = Rates {
                        distance,
                        by_swivel: near.gradient.dot(rate) * near.share * share,
                        by_time: -near.gradient.dot(&obstacle.velocity),
                    };
                }
            }
        }
        least
    }
}

impl ArmClearance {
    pub fn new(arm: &SrsArm, radius: f64) -> Result<Self> {
        let geometry = LinkGeometry::joint_to_joint(arm.chain(), radius)?;
        let plain = plain(arm)?;
        Ok(Self { arm: arm.clone(), geometry, radius, lengths: arm.lengths(), plain })
    }

    /// Prepares a pose; distances beyond `beyond` need not be told apart. `None` where the two links are not plain.
    pub fn over(&self, pose: &Pose, scene: &Scene, beyond: f64) -> Option<OverPose> {
        let [first, last] = self.plain?;
        let shoulder = self.arm.shoulder();
        let at = |local: &Vector3<f64>| pose.rotation * local + pose.translation.vector;
        let wrist = at(&self.arm.wrist_in_tool());
        let (last, tip) = (at(&last), pose.translation.vector);
        let mut over = OverPose { shoulder, wrist, upper: Vec::new(), fore: Vec::new(), fixed: beyond };
        for (shape, (center, ball)) in scene.shapes_and_balls() {
            let near = |from: &Vector3<f64>, length: f64| {
                (center - from).norm() <= length + ball + self.radius + beyond
            };
            for (start, end) in [(first, shoulder), (wrist, last), (last, tip)] {
                let length = (end - start).norm();
                if length > 0.0 && near(&start, length) {
                    over.fixed = over.fixed.min(segment_distance(&start, &end, shape).distance - self.radius);
                }
            }
            if near(&shoulder, self.lengths[0]) {
                over.upper.push(*shape);
            }
            if near(&wrist, self.lengths[1]) {
                over.fore.push(*shape);
            }
        }
        Some(over)
    }

    /// Distance over a prepared pose with the elbow at a point of the world.
    #[inline]
    pub fn at_elbow(&self, over: &OverPose, elbow: &Vector3<f64>) -> f64 {
        let links = [(&over.shoulder, &over.upper), (&over.wrist, &over.fore)];
        let each = links.into_iter().flat_map(|(from, shapes)| {
            shapes.iter().map(|shape| segment_distance(from, elbow, shape).distance)
        });
        each.fold(over.fixed + self.radius, f64::min) - self.radius
    }

    /// Prepares a pose at time `t` for [`Now::rates`], without allocation where the two links are plain.
    pub fn now<'a>(&'a self, pose: &Pose, scene: &'a Scene, t: f64) -> Now<'a> {
        let mut now = Now {
            near: self,
            scene,
            t,
            shoulder: self.arm.shoulder(),
            wrist: pose.rotation * self.arm.wrist_in_tool() + pose.translation.vector,
            fixed: Rates { distance: f64::INFINITY, by_swivel: 0.0, by_time: 0.0 },
        };
        let Some([first, last]) = self.plain else { return now };
        let last = pose.rotation * last + pose.translation.vector;
        let fixed = [(first, now.shoulder), (now.wrist, last), (last, pose.translation.vector)]
            .map(|(a, b)| (a, b, 0.0));
        now.fixed = now.least(now.fixed, &fixed, &Vector3::zeros());
        now
    }

    fn rates_by_kinematics(
        &self,
        motion: &SelfMotion,
        scene: &Scene,
        t: f64,
        u: [f64; 2],
        branch: usize,
    ) -> Rates {
        let (q, rates) = motion.branch_with_rates(u, branch);
        let mut scratch = Scratch::new(self.arm.chain());
        let kinematics = self.arm.chain().kinematics_unchecked(&q, &mut scratch);
        let scene = scene.at(t);
        let mut least = Rates { distance: f64::INFINITY, by_swivel: 0.0, by_time: 0.0 };
        scene.each_pair(&self.geometry, &kinematics, 0.0, |capsule, obstacle, near| {
            let capsule = &self.geometry.capsules()[capsule];
            let distance = near.distance - capsule.radius;
            if distance < least.distance {
                let mut gradient = [0.0; 7];
                capsule.add_gradient(&kinematics, near, 1.0, &mut gradient);
                least = Rates {
                    distance,
                    by_swivel: gradient.iter().zip(&rates).map(|(g, r)| g * r).sum(),
                    by_time: -near.gradient.dot(&scene.obstacles()[obstacle].velocity),
                };
            }
        });
        least
    }

    /// Distance at a configuration, by its kinematics.
    pub fn at_q(&self, q: &[f64], scene: &Scene, scratch: &mut Scratch) -> f64 {
        let kinematics = self.arm.chain().kinematics_unchecked(q, scratch);
        scene.clearance_at(&self.geometry, &kinematics).map_or(f64::INFINITY, |pair| pair.distance)
    }

    /// Distance at the swivel `s` of the branch whose configuration is `q`.
    pub fn of_one(
        &self,
        motion: &SelfMotion,
        over: Option<&OverPose>,
        scene: &Scene,
        s: f64,
        q: &[f64; 7],
        scratch: &mut Scratch,
    ) -> f64 {
        match over {
            Some(over) => {
                let (sin, cos) = s.sin_cos();
                self.at_elbow(over, &motion.elbow([cos, sin]))
            }
            None => self.at_q(q, scene, scratch),
        }
    }

    /// Distances at the swivel `s` of all branches, in branch order.
    pub fn of_branches(
        &self,
        motion: &SelfMotion,
        over: Option<&OverPose>,
        scene: &Scene,
        s: f64,
        q: &[[f64; 7]; 8],
        scratch: &mut Scratch,
    ) -> [f64; 8] {
        match over {
            Some(over) => {
                let (sin, cos) = s.sin_cos();
                [self.at_elbow(over, &motion.elbow([cos, sin])); 8]
            }
            None => std::array::from_fn(|b| self.at_q(&q[b], scene, scratch)),
        }
    }
}

/// Joint 1 in the world and joint 7 in the tool frame, when the joints in between lie on shoulder, elbow and wrist.
fn plain(arm: &SrsArm) -> Result<Option<[Vector3<f64>; 2]>> {
    let chain = arm.chain();
    let mut scratch = Scratch::new(chain);
    let mut found = None;
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
        let ends = [o[0], pose.rotation.inverse() * (o[6] - pose.translation.vector)];
        if !fits || found.is_some_and(|[a, b]: [Vector3<f64>; 2]| !same(&a, &ends[0]) || !same(&b, &ends[1]))
        {
            return Ok(None);
        }
        found = Some(ends);
    }
    Ok(found)
}
