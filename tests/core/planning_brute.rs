//! Plans of the swivel beside brute force: a plain grid search, a dense check of what is executed, exhaustive search where
//! there is said to be nothing.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, catalog};
use redundancy_core::nalgebra::{Rotation3, Translation3, Vector3};
use redundancy_core::path::{Path, Plan};
use redundancy_core::planning::{SwivelChoice, SwivelPlanSettings, plan_swivel};
use redundancy_core::scene::{Capsule, Cuboid, Scene, Shape, Sphere};
use redundancy_core::solutions::{SelfMotion, SrsArm};
use redundancy_core::{Pose, Status, Watch};

use crate::planning::iiwa_raster;
use crate::planning_scene::{ball, laps, ramp};
use crate::support::{amount, pa10, pose_error, rows, swivel};

fn distance(scene: &Scene, chain: &Chain, q: &[f64]) -> f64 {
    scene.clearance(chain, q, 0.05).unwrap().map_or(f64::INFINITY, |near| near.distance)
}

fn within(chain: &Chain, q: &[f64; 7]) -> bool {
    (0..7).all(|i| q[i] >= chain.lower()[i] && q[i] <= chain.upper()[i])
}

/// All ways to wind `q` within the limits.
fn windings(chain: &Chain, q: &[f64; 7]) -> Vec<[f64; 7]> {
    let mut out = vec![*q];
    for i in 0..7 {
        let (lower, upper) = (chain.lower()[i], chain.upper()[i]);
        let turns = if lower.is_finite() { ((lower - q[i]) / TAU).ceil() } else { 0.0 };
        let mut next = Vec::new();
        for q in out {
            let mut wound = q;
            wound[i] += TAU * turns;
            while wound[i] <= upper && next.len() < 64 {
                next.push(wound);
                wound[i] += TAU;
                if !upper.is_finite() {
                    break;
                }
            }
        }
        out = next;
    }
    out
}

/// The functional of `docs/planning.md`, from the wound joints alone.
struct Cost<'a> {
    arm: &'a SrsArm,
    settings: &'a SwivelPlanSettings,
    parts: Vec<f64>,
}

impl<'a> Cost<'a> {
    fn new(arm: &'a SrsArm, path: &Path, settings: &'a SwivelPlanSettings) -> Self {
        let n = path.len();
        let parts = match path.t() {
            Some(t) => t.windows(2).map(|w| (w[1] - w[0]) / (t[n - 1] - t[0])).collect(),
            None => vec![1.0 / (n - 1) as f64; n - 1],
        };
        Self { arm, settings, parts }
    }

    fn place(&self, k: usize, q: &[f64; 7], s: f64) -> f64 {
        let (chain, settings) = (self.arm.chain(), self.settings);
        let mut cost = 0.0;
        if let Some(scene) = &settings.scene {
            let near = distance(scene, chain, q);
            if near <= 0.0 {
                return f64::INFINITY;
            }
            let missing = (1.0 - near / settings.wanted_clearance).max(0.0);
            cost += settings.clearance_weight * 100.0 * missing * missing;
        }
        for i in 0..7 {
            let (lower, upper) = (chain.lower()[i], chain.upper()[i]);
            if (upper - lower).is_finite() {
                let x = (2.0 * q[i] - lower - upper) / (upper - lower);
                let near = (x * x / (1.0 - x * x).max(1e-9)).min(1e3);
                cost += settings.limit_weight * near * near;
            }
        }
        if let SwivelChoice::Near(wish) = &settings.choice {
            let wish = if wish.len() == 1 { wish[0] } else { wish[k] };
            cost += settings.swivel_weight * (1.0 - (s - wish).cos());
        }
        let before = if k > 0 { self.parts[k - 1] } else { 0.0 };
        cost * 0.5 * (before + self.parts.get(k).copied().unwrap_or(0.0))
    }

    fn step(&self, k: usize, a: &[f64; 7], b: &[f64; 7]) -> f64 {
        let square: f64 = (0..7).map(|i| (b[i] - a[i]).powi(2)).sum();
        self.settings.motion_weight * square / self.parts[k]
    }

    fn of(&self, plan: &Plan) -> f64 {
        let n = rows(plan).len();
        let places: f64 = (0..n).map(|k| self.place(k, &rows(plan)[k], swivel(plan)[k])).sum();
        places + (1..n).map(|k| self.step(k - 1, &rows(plan)[k - 1], &rows(plan)[k])).sum::<f64>()
    }
}

/// A node of a plain grid.
struct Node {
    branch: usize,
    cell: usize,
    q: [f64; 7],
    cost: f64,
}

/// Where the nodes of a branch and cell are.
fn by_cell(nodes: &[Node], cells: usize) -> Vec<Vec<usize>> {
    let mut out = vec![Vec::new(); 8 * cells];
    for (i, node) in nodes.iter().enumerate() {
        out[node.branch * cells + node.cell].push(i);
    }
    out
}

/// The least cost over a grid of swivels, all branches and windings, steps of up to `reach` cells; written without
/// anything of the planner's.
fn grid_search(arm: &SrsArm, path: &Path, settings: &SwivelPlanSettings, cells: usize, reach: isize) -> f64 {
    let cost = Cost::new(arm, path, settings);
    let layer = |k: usize| -> Vec<Node> {
        let motion = arm.self_motion(&path.poses()[k]).unwrap();
        let mut nodes = Vec::new();
        for branch in motion.branches() {
            if settings.branch.is_some_and(|only| only != branch.index()) {
                continue;
            }
            for cell in 0..cells {
                let s = TAU * cell as f64 / cells as f64;
                for q in windings(arm.chain(), &branch.q(s).unwrap()) {
                    let place = cost.place(k, &q, s);
                    if place.is_finite() {
                        nodes.push(Node { branch: branch.index(), cell, q, cost: place });
                    }
                }
            }
        }
        nodes
    };
    let mut before = layer(0);
    for k in 1..path.len() {
        let mut here = layer(k);
        let by_cell = by_cell(&before, cells);
        for node in &mut here {
            let mut best = f64::INFINITY;
            for offset in -reach..=reach {
                let cell = (node.cell as isize + offset).rem_euclid(cells as isize) as usize;
                for i in &by_cell[node.branch * cells + cell] {
                    let source = &before[*i];
                    if (0..7).all(|i| (node.q[i] - source.q[i]).abs() <= FRAC_PI_4) {
                        best = best.min(source.cost + cost.step(k - 1, &source.q, &node.q));
                    }
                }
            }
            node.cost += best;
        }
        here.retain(|node| node.cost.is_finite());
        before = here;
    }
    before.iter().map(|node| node.cost).fold(f64::INFINITY, f64::min)
}

/// Every `stride`-th point.
fn thinned(path: &Path, stride: usize) -> Path {
    let poses: Vec<Pose> = path.poses().iter().step_by(stride).copied().collect();
    let t: Option<Vec<f64>> = path.t().map(|t| t.iter().step_by(stride).copied().collect());
    Path::new(&poses, None, t.as_deref()).unwrap()
}

#[test]
fn a_plan_costs_no_more_than_a_plain_grid_search() {
    let compare = |name: &str, arm: &SrsArm, path: &Path, settings: &SwivelPlanSettings, cells: usize| {
        let plan = plan_swivel(arm, path, settings, &Watch::default()).unwrap();
        assert_eq!(plan.status(), Status::Converged, "{name}: {}", plan.reason());
        let ours = Cost::new(arm, path, settings).of(&plan);
        assert!((plan.cost().unwrap() / ours - 1.0).abs() < 1e-9, "{name}: {:?} {ours}", plan.cost());
        let grid = grid_search(arm, path, settings, cells, (cells / 24) as isize);
        assert!(ours <= grid * (1.0 + 1e-9), "{name}: {ours}, grid search {grid}");
    };
    let iiwa = SrsArm::new(&catalog::load("iiwa14").unwrap()).unwrap();
    let raster = Path::new(&iiwa_raster(1_000), None, None).unwrap();
    compare("raster", &iiwa, &raster, &SwivelPlanSettings::default(), amount(90, 360));
    let pa10 = SrsArm::new(&pa10()).unwrap();
    let stride = amount(12, 3);
    for (name, desired) in [("clear", vec![-FRAC_PI_2]), ("fast", ramp(5.0 * PI)), ("slow", ramp(PI))] {
        let wish = if desired.len() > 1 { desired.into_iter().step_by(stride).collect() } else { desired };
        let settings = SwivelPlanSettings {
            scene: Some(ball()),
            choice: SwivelChoice::Near(wish),
            branch: Some(0),
            ..Default::default()
        };
        compare(name, &pa10, &thinned(&laps(), stride), &settings, amount(180, 360));
    }
}

/// A smooth path of full poses through a configuration of the arm, and obstacles around the arm.
fn problem(arm: &SrsArm, rng: &mut ChaCha8Rng, hard: bool) -> (Path, Scene) {
    let chain = arm.chain();
    let mut unit = || Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let far = if hard { 2.0 } else { 1.0 };
    let (direction, bend, turn) = (unit() * 0.35 * far, unit() * 0.1, unit() * 0.8 * far);
    let (poses, q) = loop {
        let q: Vec<f64> = (0..7)
            .map(|i| {
                let (lower, upper) = (chain.lower()[i].max(-PI), chain.upper()[i].min(PI));
                0.8 * rng.random_range(lower..upper)
            })
            .collect();
        let start = chain.forward(&q).unwrap();
        let n = rng.random_range(20..80);
        let poses: Vec<Pose> = (0..n)
            .map(|k| {
                let f = f64::from(k) / f64::from(n - 1);
                let shift = direction * f + bend * (PI * f).sin();
                let rotation = Rotation3::new(turn * f) * start.rotation;
                Pose::from_parts(Translation3::from(start.translation.vector + shift), rotation)
            })
            .collect();
        if poses.iter().all(|pose| arm.self_motion(pose).unwrap().status() == Status::Converged) {
            break (poses, q);
        }
    };
    // Near the elbow's way round, so that some swivels are free and others are not.
    let elbow = chain.forward_link(&q, chain.link_index(&chain.links()[4].name).unwrap()).unwrap();
    let count = rng.random_range(1..5) + if hard { 2 } else { 0 };
    let shapes: Vec<Shape> = (0..count)
        .map(|i| {
            let mut near = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
            let (center, other, turn) = (elbow.translation.vector + near(0.5), near(0.3), near(3.0));
            let size = rng.random_range(0.02..0.12);
            match i % 3 {
                0 => Sphere { center, radius: size }.into(),
                1 => Capsule { start: center, end: center + other, radius: 0.5 * size }.into(),
                _ => Cuboid {
                    pose: Pose::from_parts(Translation3::from(center), Rotation3::new(turn)),
                    half_extents: Vector3::new(size, 0.3 * size, 2.0 * size),
                }
                .into(),
            }
        })
        .collect();
    (Path::new(&poses, None, None).unwrap(), Scene::new(&shapes).unwrap())
}

/// Ten times finer than the path: joints straight between the rows, and the pose solved again between the points.
fn check_dense(arm: &SrsArm, path: &Path, scene: &Scene, plan: &Plan) -> Result<(), String> {
    let chain = arm.chain();
    for k in 0..rows(plan).len() {
        assert!(pose_error(&chain.forward(&rows(plan)[k]).unwrap(), &path.poses()[k]) < 1e-10);
        if !within(chain, &rows(plan)[k]) || distance(scene, chain, &rows(plan)[k]) <= 0.0 {
            return Err(format!("at point {k}"));
        }
    }
    for k in 1..rows(plan).len() {
        let (a, b) = (&rows(plan)[k - 1], &rows(plan)[k]);
        if (0..7).any(|i| (b[i] - a[i]).abs() > FRAC_PI_4) {
            return Err(format!("a jump before point {k}"));
        }
        for j in 1..10 {
            let f = f64::from(j) / 10.0;
            let straight: [f64; 7] = std::array::from_fn(|i| a[i] + f * (b[i] - a[i]));
            let near = distance(scene, chain, &straight);
            if near <= 0.0 || !within(chain, &straight) {
                return Err(format!("joints straight to point {k}: {near}"));
            }
            let (from, to) = (path.s()[k - 1], path.s()[k]);
            let pose = path.at(from + f * (to - from)).unwrap().pose;
            let s = swivel(plan)[k - 1] + f * (swivel(plan)[k] - swivel(plan)[k - 1]);
            let again = arm
                .self_motion(&pose)
                .unwrap()
                .branch(plan.pieces().unwrap().index[k])
                .unwrap()
                .q(s)
                .unwrap();
            let again: [f64; 7] =
                std::array::from_fn(|i| again[i] + TAU * ((straight[i] - again[i]) / TAU).round());
            let near = distance(scene, chain, &again);
            let off = (0..7).map(|i| (again[i] - straight[i]).abs()).fold(0.0, f64::max);
            let outside = (0..7)
                .map(|i| (chain.lower()[i] - again[i]).max(again[i] - chain.upper()[i]))
                .fold(0.0, f64::max);
            if near <= 0.0 || outside > 1e-3 || off > 0.1 {
                return Err(format!("solved again before point {k}: {near} m, {outside}, {off} rad"));
            }
        }
    }
    Ok(())
}

/// Whether some line of a finer grid leads along the path without contact, at its points and between them.
fn some_line_exists(arm: &SrsArm, path: &Path, scene: &Scene, cells: usize) -> bool {
    let chain = arm.chain();
    let layer = |motion: &SelfMotion| -> Vec<Node> {
        let mut nodes = Vec::new();
        for branch in motion.branches() {
            for cell in 0..cells {
                let q = branch.q(TAU * cell as f64 / cells as f64).unwrap();
                let wound = windings(chain, &q);
                if !wound.is_empty() && distance(scene, chain, &q) > 0.0 {
                    nodes.extend(wound.into_iter().map(|q| Node {
                        branch: branch.index(),
                        cell,
                        q,
                        cost: 0.0,
                    }));
                }
            }
        }
        nodes
    };
    let clear = |a: &[f64; 7], b: &[f64; 7]| {
        (1..20).all(|j| {
            let f = f64::from(j) / 20.0;
            let q: [f64; 7] = std::array::from_fn(|i| a[i] + f * (b[i] - a[i]));
            distance(scene, chain, &q) > 0.0
        })
    };
    let mut before = layer(&arm.self_motion(&path.poses()[0]).unwrap());
    for pose in &path.poses()[1..] {
        let mut here = layer(&arm.self_motion(pose).unwrap());
        let by_cell = by_cell(&before, cells);
        here.retain(|node| {
            // From the nearest swivels outwards, up to a quarter turn.
            (0..cells as isize / 2).any(|i| {
                let offset = if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 };
                let cell = (node.cell as isize + offset).rem_euclid(cells as isize) as usize;
                by_cell[node.branch * cells + cell].iter().any(|i| {
                    let source = &before[*i];
                    (0..7).all(|i| (node.q[i] - source.q[i]).abs() <= FRAC_PI_4) && clear(&source.q, &node.q)
                })
            })
        });
        if here.is_empty() {
            return false;
        }
        before = here;
    }
    true
}

#[test]
fn random_scenes_are_solved_or_cannot_be() {
    let mut counts = [0usize; 3];
    for name in ["iiwa14", "pa10"] {
        let arm = SrsArm::new(&catalog::load(name).unwrap()).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        for case in 0..amount(4, 50) {
            // Every other problem is long and cluttered: some of those take a reconfiguration.
            let (path, scene) = problem(&arm, &mut rng, case % 2 == 1);
            let settings = SwivelPlanSettings { scene: Some(scene.clone()), ..Default::default() };
            let plan = plan_swivel(&arm, &path, &settings, &Watch::default()).unwrap();
            match plan.status() {
                Status::Converged => {
                    counts[0] += 1;
                    if let Err(what) = check_dense(&arm, &path, &scene, &plan) {
                        panic!("{name} {case}: {what}");
                    }
                }
                Status::Infeasible => {
                    counts[1] += 1;
                    assert!(!plan.reconfigurations().is_empty());
                    let exists = some_line_exists(&arm, &path, &scene, amount(360, 1_440));
                    assert!(!exists, "{name} {case}: {}", plan.reason());
                }
                Status::Collision => {
                    counts[2] += 1;
                    let motion = arm.self_motion(&path.poses()[plan.blocked()[0].row]).unwrap();
                    let free = |q: [f64; 7]| {
                        !windings(arm.chain(), &q).is_empty() && distance(&scene, arm.chain(), &q) > 0.0
                    };
                    let some = motion.branches().iter().any(|branch| {
                        (0..7_200).any(|i| free(branch.q(TAU * f64::from(i) / 7_200.0).unwrap()))
                    });
                    assert!(!some, "{name} {case}: {}", plan.reason());
                }
                other => panic!("{name} {case}: {other} {}", plan.reason()),
            }
        }
    }
    eprintln!("solved, infeasible, blocked: {counts:?}");
    assert!(counts[0] >= 3 && counts[1] + counts[2] > 0, "{counts:?}");
}

#[test]
fn a_closed_path_closes_in_the_joints_after_ten_rounds() {
    let arm = SrsArm::new(&pa10()).unwrap();
    let down = Rotation3::from_euler_angles(0.0, PI, 0.0);
    let pose = |k: usize, n: usize| {
        let a = TAU * (k % n) as f64 / n as f64;
        Pose::from_parts(Translation3::new(0.45 + 0.12 * a.cos(), 0.12 * a.sin(), 0.5), down)
    };
    let settings = SwivelPlanSettings { cyclic: true, scene: Some(ball()), ..Default::default() };
    let run = |poses: &[Pose]| {
        let path = Path::new(poses, None, None).unwrap();
        let plan = plan_swivel(&arm, &path, &settings, &Watch::default()).unwrap();
        assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
        plan
    };
    let gap = |a: &[f64; 7], b: &[f64; 7]| (0..7).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max);
    // One lap, executed ten times: where it ends the next one begins.
    let lap = run(&(0..=120).map(|k| pose(k, 120)).collect::<Vec<_>>());
    assert!(gap(&rows(&lap)[0], &rows(&lap)[120]) < 1e-9);
    // Ten laps as one path.
    let ten = run(&(0..=1_000).map(|k| pose(k, 100)).collect::<Vec<_>>());
    assert!(gap(&rows(&ten)[0], &rows(&ten)[1_000]) < 1e-9);
    let apart = (1..10).map(|lap| gap(&rows(&ten)[0], &rows(&ten)[100 * lap])).fold(0.0, f64::max);
    assert!(apart < 1e-2, "{apart}");
}

/// The size of the bench: 1 000 points x 360 swivels x 8 branches beside five primitives.
#[test]
fn the_raster_beside_five_primitives_is_clear_ten_times_finer() {
    let arm = SrsArm::new(&catalog::load("iiwa14").unwrap()).unwrap();
    let ball = |x, y, z| Sphere { center: Vector3::new(x, y, z), radius: 0.08 };
    let post = |x, y| Capsule { start: Vector3::new(x, y, 0.0), end: Vector3::new(x, y, 0.9), radius: 0.04 };
    let table =
        Cuboid { pose: Pose::translation(0.6, 0.0, -0.05), half_extents: Vector3::new(0.3, 0.5, 0.05) };
    let scene = Scene::new(&[
        ball(0.25, 0.45, 0.6).into(),
        ball(0.3, -0.1, 0.95).into(),
        post(0.35, -0.5).into(),
        post(0.2, 0.6).into(),
        table.into(),
    ])
    .unwrap();
    let path = Path::new(&iiwa_raster(1_000), None, None).unwrap();
    let settings = SwivelPlanSettings { swivels: 360, scene: Some(scene.clone()), ..Default::default() };
    let plan = plan_swivel(&arm, &path, &settings, &Watch::default()).unwrap();
    assert_eq!(plan.status(), Status::Converged, "{}", plan.reason());
    // The raster's corners are no smooth curve: there the pose between two points is off the straight line.
    check_dense(&arm, &path, &scene, &plan).unwrap();
    assert!(plan.clearance().unwrap().iter().all(|d| *d >= 0.03));
}
