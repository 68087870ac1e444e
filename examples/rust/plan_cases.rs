//! Plans the whole-path cases of `tests/golden/plan_cases` and compares the results with the best known values.
//!
//! `cargo run --release --example plan_cases [name]`

#![allow(clippy::print_stdout)] // an example may talk

use std::time::Instant;

use redundancy_core::Watch;
use redundancy_core::chain::{Chain, MissingLimits};
use redundancy_core::kinematics::{SpinFreedom, ToolFreedom};
use redundancy_core::path::Path;
use redundancy_core::planning::{Objective, PlanSettings, plan};

struct Case {
    name: &'static str,
    urdf: &'static str,
    ends: [&'static str; 2],
    path: &'static str,
    half_angle: f64,
    spin: SpinFreedom,
    dt: f64,
    speed: f64,
    objective: Objective,
    accept: &'static str,
}

const GUN: [&str; 2] = ["base_link", "gun"];
const IIWA: [&str; 2] = ["lbr_iiwa_link_0", "lbr_iiwa_link_7"];
const PANDA: [&str; 2] = ["panda_link0", "panda_link8"];

fn cases() -> Vec<Case> {
    let case = |name, urdf, ends, path, half_angle, spin, dt, speed, objective, accept| Case {
        name,
        urdf,
        ends,
        path,
        half_angle,
        spin,
        dt,
        speed,
        objective,
        accept,
    };
    let (free, fixed) = (SpinFreedom::Free, SpinFreedom::Within(0.0));
    let (iiwa, panda, gun) = (0.03093093093093092, 0.03628628628628629, 0.04204204204204203);
    use Objective::{Length, Motion, PeakSpeed};
    vec![
        case(
            "iiwa_pose",
            "iiwa14.urdf",
            IIWA,
            "iiwa14_raster_pose.csv",
            0.0,
            fixed,
            iiwa,
            0.2,
            Motion,
            "S .2758",
        ),
        case(
            "iiwa_spin",
            "iiwa14.urdf",
            IIWA,
            "iiwa14_raster_spin.csv",
            0.0,
            free,
            iiwa,
            0.2,
            Motion,
            "S .1675",
        ),
        case(
            "irb_cone",
            "irb2400.urdf",
            GUN,
            "irb2400_raster_cone.csv",
            20.0,
            free,
            gun,
            0.2,
            Motion,
            "S .0689",
        ),
        case(
            "irb_length",
            "irb2400.urdf",
            GUN,
            "irb2400_raster_cone.csv",
            20.0,
            free,
            gun,
            0.2,
            Length,
            "L 8.20",
        ),
        case(
            "irb_peak",
            "irb2400.urdf",
            GUN,
            "irb2400_raster_cone.csv",
            20.0,
            free,
            gun,
            0.2,
            PeakSpeed,
            "V .190 L 8.35",
        ),
        case(
            "panda_20",
            "panda.urdf",
            PANDA,
            "panda_raster_pose.csv",
            0.0,
            fixed,
            panda,
            0.2,
            Motion,
            "S .4815",
        ),
        case(
            "panda_47",
            "panda.urdf",
            PANDA,
            "panda_raster_pose.csv",
            0.0,
            fixed,
            panda,
            0.47,
            Motion,
            "S .4830",
        ),
        case(
            "panda_48",
            "panda.urdf",
            PANDA,
            "panda_raster_pose.csv",
            0.0,
            fixed,
            panda,
            0.48,
            Motion,
            "S .512",
        ),
        case(
            "iiwa_cone",
            "iiwa14.urdf",
            IIWA,
            "iiwa14_raster_pose.csv",
            20.0,
            free,
            iiwa,
            0.2,
            Motion,
            "S .1115",
        ),
        case(
            "irb_spin",
            "irb2400.urdf",
            GUN,
            "irb2400_raster_cone.csv",
            0.0,
            free,
            gun,
            0.2,
            Motion,
            "S .0880",
        ),
    ]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/plan_cases");
    let only = std::env::args().nth(1);
    let seeds: u64 = std::env::args().nth(2).map_or(Ok(1), |n| n.parse())?;
    for case in
        cases().iter().filter(|case| only.as_ref().is_none_or(|only| only == case.name || only == "all"))
    {
        for seed in 0..seeds {
            run(case, &folder, seed)?;
        }
    }
    Ok(())
}

fn run(case: &Case, folder: &std::path::Path, seed: u64) -> Result<(), Box<dyn std::error::Error>> {
    let [base, tip] = case.ends;
    let chain = Chain::from_urdf(folder.join(case.urdf), Some(base), Some(tip), MissingLimits::Refuse)?;
    let path = Path::from_csv(folder.join(case.path))?;
    let t: Vec<f64> = (0..path.len()).map(|k| k as f64 * case.dt * 0.2 / case.speed).collect();
    let path = path.with_times(Some(&t))?;
    let equal = (case.objective == Objective::PeakSpeed).then(|| vec![1.0; chain.dof()]);
    let settings = PlanSettings {
        freedom: ToolFreedom::new(case.half_angle.to_radians(), case.spin, [0.0, 0.0, 1.0])?,
        objective: case.objective,
        limit_weight: 0.0,
        velocity_limits: Some(chain.joints().iter().map(|j| j.limits.velocity).collect()),
        speed_weights: equal,
        seed,
        ..PlanSettings::default()
    };
    let begin = Instant::now();
    let plan = plan(&chain, &path, &settings, &Watch::default())?;
    let time = begin.elapsed().as_secs_f64();
    let n = chain.dof();
    let (mut s, mut l, mut v): (f64, f64, f64) = (0.0, 0.0, 0.0);
    let q: Vec<&[f64]> = plan.q().chunks_exact(n).collect();
    for (k, pair) in q.windows(2).enumerate() {
        let d: Vec<f64> = pair[1].iter().zip(pair[0]).map(|(b, a)| b - a).collect();
        let square: f64 = d.iter().map(|d| d * d).sum();
        s += square;
        l += square.sqrt();
        v = d.iter().fold(v, |v, d| v.max(d.abs() / (t[k + 1] - t[k])));
    }
    println!(
        "{:11} seed {seed}: {:15} {time:6.3} s   S {s:.6} L {l:.5} V {v:.5}   accept {:14} {}",
        case.name,
        plan.status().to_string(),
        case.accept,
        plan.reason()
    );
    Ok(())
}
