//! Pose and Jacobian: against differences, against each other, in batches, without allocating.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::chain::{Chain, Inertia, Limits, MissingLimits, catalog};
use redundancy_core::kinematics::{DynamicsScratch, JacobianFrame, JacobianOf, Scratch};
use redundancy_core::nalgebra::{Matrix3, Matrix6xX, Vector3, Vector6};
use redundancy_core::{Error, Pose, pose_to_row_major};

use crate::allocations;

/// All arms of the catalogue, with base and tool, and one with sliding and endless joints.
fn arms() -> Vec<Chain> {
    let shift = redundancy_core::nalgebra::IsometryMatrix3::new(
        Vector3::new(0.1, -0.2, 0.3),
        Vector3::new(0.4, 0.5, -0.6),
    );
    let mut arms: Vec<Chain> = catalog::names().map(|name| catalog::load(name).unwrap()).collect();
    arms.push(arms[2].with_base(shift).unwrap().with_tool(shift.inverse()).unwrap());
    let urdf = include_str!("../data/arm.urdf");
    arms.push(Chain::from_urdf_string(urdf, Some("world"), Some("flange"), MissingLimits::Refuse).unwrap());
    arms
}

fn random_q(rng: &mut ChaCha8Rng, dof: usize) -> Vec<f64> {
    (0..dof).map(|_| rng.random_range(-3.0..3.0)).collect()
}

/// Velocity of the tool by central differences: linear, then angular in the world.
fn difference(arm: &Chain, q: &[f64], joint: usize) -> Vector6<f64> {
    let h = 1e-6;
    let at = |step: f64| {
        let mut q = q.to_vec();
        q[joint] += step;
        arm.forward(&q).unwrap()
    };
    let (plus, minus): (Pose, Pose) = (at(h), at(-h));
    let linear = (plus.translation.vector - minus.translation.vector) / (2.0 * h);
    // sin(angle) times the axis, from the skew part: an arc cosine would lose half of the digits
    let turn = *(plus.rotation * minus.rotation.inverse()).matrix();
    let skew = (turn - turn.transpose()) / (4.0 * h);
    let angular = Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]);
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

#[test]
fn jacobian_against_central_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for arm in arms() {
        for _ in 0..100 {
            let q = random_q(&mut rng, arm.dof());
            let jacobian = arm.jacobian(&q).unwrap();
            for joint in 0..arm.dof() {
                let error = (jacobian.column(joint) - difference(&arm, &q, joint)).amax();
                assert!(error < 2e-9, "{} joint {joint}: {error:e}", arm.name());
            }
        }
    }
}

#[test]
fn one_pass_gives_what_the_single_calls_give() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for arm in arms() {
        let mut scratch = Scratch::new(&arm);
        let q = random_q(&mut rng, arm.dof());
        let tool_velocity = {
            let qd = random_q(&mut rng, arm.dof());
            let expected =
                arm.jacobian(&q).unwrap() * redundancy_core::nalgebra::DVector::from_column_slice(&qd);
            (arm.tool_velocity(&q, &qd).unwrap() - expected).amax()
        };
        assert!(tool_velocity < 1e-13);
        let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
        assert_eq!(kinematics.pose(), &arm.forward(&q).unwrap());
        assert_eq!(kinematics.jacobian(), &arm.jacobian(&q).unwrap());
        for (axis, column) in kinematics.axes().iter().zip(kinematics.jacobian().column_iter()) {
            assert!((axis.norm() - 1.0).abs() < 1e-14);
            let turning = column.fixed_rows::<3>(3).norm() > 0.5;
            let seen = if turning { column.fixed_rows::<3>(3) } else { column.fixed_rows::<3>(0) };
            assert_eq!(seen, *axis);
        }
        let mut rows = vec![0.0; 6 * arm.dof()];
        kinematics.write_jacobian(&mut rows);
        let back = Matrix6xX::from_row_slice(&rows);
        assert_eq!(&back, kinematics.jacobian());
    }
}

#[test]
fn last_link_and_tool() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for arm in arms() {
        let q = random_q(&mut rng, arm.dof());
        let last = arm.forward_link(&q, arm.links().len() - 1).unwrap() * arm.tool();
        assert!((last.to_homogeneous() - arm.forward(&q).unwrap().to_homogeneous()).amax() < 1e-14);
        assert_eq!(&arm.forward_link(&q, 0).unwrap(), arm.base());
    }
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    let arm = catalog::load("iiwa14").unwrap();
    let (n, dof) = (3001, arm.dof());
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let q: Vec<f64> = (0..n * dof).map(|_| rng.random_range(-3.0..3.0)).collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mut poses, mut jacobians) = (vec![0.0; n * 16], vec![0.0; n * 6 * dof]);
            arm.kinematics_batch(&q, &mut poses, &mut jacobians).unwrap();
            let (mut p, mut j) = (vec![0.0; n * 16], vec![0.0; n * 6 * dof]);
            arm.forward_batch(&q, None, &mut p).unwrap();
            arm.jacobian_batch(&q, &mut j).unwrap();
            assert_eq!((&p, &j), (&poses, &jacobians));
            (poses, jacobians)
        })
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert_eq!(run(threads), one);
    }
    for (i, q) in q.chunks_exact(dof).enumerate() {
        assert_eq!(one.0[16 * i..16 * (i + 1)], pose_to_row_major(&arm.forward(q).unwrap()));
    }
    let link = arm.link_index("link_4").unwrap();
    let mut poses = vec![0.0; n * 16];
    arm.forward_batch(&q, Some(link), &mut poses).unwrap();
    assert_eq!(poses[16..32], pose_to_row_major(&arm.forward_link(&q[dof..2 * dof], link).unwrap()));
}

#[test]
fn nothing_allocates_with_a_scratch() {
    for arm in arms() {
        let q = vec![0.3; arm.dof()];
        let mut scratch = Scratch::new(&arm);
        let mut rows = vec![0.0; 6 * arm.dof()];
        let times = allocations::count(|| {
            for _ in 0..10 {
                let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
                kinematics.write_jacobian(&mut rows);
                let _ = arm.forward(&q).unwrap();
                let _ = arm.forward_link(&q, 1).unwrap();
            }
        });
        assert_eq!(times, 0, "{}", arm.name());
    }
}

#[test]
fn what_is_wrong_is_named() {
    let arm = catalog::load("pa10").unwrap();
    let mut other = Scratch::new(&catalog::load("planar3r").unwrap());
    let nan = [0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0];
    let mut small = [0.0; 15];
    let table: Vec<(Error, &[&str])> = vec![
        (arm.forward(&[0.0; 6]).unwrap_err(), &["q", "expected 7", "got 6"]),
        (arm.forward(&nan).unwrap_err(), &["q", "entry 2", "NaN"]),
        (arm.jacobian(&[0.0; 8]).unwrap_err(), &["q", "expected 7", "got 8"]),
        (arm.kinematics(&[0.0; 7], &mut other).unwrap_err(), &["scratch", "expected 7", "got 3"]),
        (arm.forward_link(&[0.0; 7], 99).unwrap_err(), &["link index", "99", "< 9"]),
        (arm.link_index("elbow").unwrap_err(), &["link", "'elbow'", "base, link1", "flange"]),
        (arm.tool_velocity(&[0.0; 7], &[0.0; 3]).unwrap_err(), &["qd", "expected 7", "got 3"]),
        (arm.forward_batch(&[0.0; 8], None, &mut small).unwrap_err(), &["batch", "expected 14", "got 8"]),
        (arm.forward_batch(&[0.0; 7], None, &mut small).unwrap_err(), &["poses", "expected 16", "got 15"]),
        (arm.forward_batch(&nan, None, &mut small).unwrap_err(), &["batch", "entry 2", "NaN"]),
        (arm.jacobian_batch(&[0.0; 7], &mut small).unwrap_err(), &["jacobians", "expected 42", "got 15"]),
    ];
    for (error, words) in table {
        let text = error.to_string();
        for word in words {
            assert!(text.contains(word), "'{text}' lacks '{word}'");
        }
    }
}

/// Points of links in the axes of links: against differences of the pose of the link, and against the Jacobian of the tool.
#[test]
fn jacobians_of_links_are_derivatives_of_their_points() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let h = 1e-6;
    for arm in arms() {
        for _ in 0..6 {
            let q = random_q(&mut rng, arm.dof());
            let pick = |rng: &mut ChaCha8Rng| rng.random_range(0..arm.links().len());
            let link = rng.random_bool(0.8).then(|| pick(&mut rng));
            let frame = match rng.random_range(0..3) {
                0 => JacobianFrame::Base,
                1 => JacobianFrame::Tool,
                _ => JacobianFrame::Link(pick(&mut rng)),
            };
            let point = Vector3::from_fn(|_, _| rng.random_range(-0.5..0.5));
            let pose = |q: &[f64]| match link {
                None => arm.forward(q).unwrap(),
                Some(link) => arm.forward_link(q, link).unwrap(),
            };
            let axes = match frame {
                JacobianFrame::Base => Pose::identity(),
                JacobianFrame::Tool => arm.forward(&q).unwrap(),
                JacobianFrame::Link(link) => arm.forward_link(&q, link).unwrap(),
            };
            let of = JacobianOf { link, point, frame };
            let jacobian = arm.jacobian_of(&q, &of).unwrap();
            for j in 0..arm.dof() {
                let moved = |step: f64| {
                    let mut q = q.clone();
                    q[j] += step;
                    pose(&q)
                };
                let (plus, minus) = (moved(h), moved(-h));
                let at = |pose: &Pose| pose.rotation * point + pose.translation.vector;
                let linear = axes.rotation.inverse() * (at(&plus) - at(&minus)) / (2.0 * h);
                let turn = *(plus.rotation * minus.rotation.inverse()).matrix();
                let skew = Vector3::new(
                    turn[(2, 1)] - turn[(1, 2)],
                    turn[(0, 2)] - turn[(2, 0)],
                    turn[(1, 0)] - turn[(0, 1)],
                );
                let angular = axes.rotation.inverse() * skew / (4.0 * h);
                let column = jacobian.column(j);
                assert!((column.fixed_rows::<3>(0) - linear).amax() < 1e-8, "{} {of:?} {j}", arm.name());
                assert!((column.fixed_rows::<3>(3) - angular).amax() < 1e-8, "{} {of:?} {j}", arm.name());
            }
            // In a batch, and without allocating.
            let (mut scratch, mut rows) = (Scratch::new(&arm), vec![0.0; 6 * arm.dof()]);
            assert_eq!(
                allocations::count(|| arm.write_jacobian_of(&q, &of, &mut scratch, &mut rows).unwrap()),
                0
            );
            let mut batch = vec![0.0; 12 * arm.dof()];
            arm.jacobian_of_batch(&[q.clone(), q.clone()].concat(), &of, &mut batch).unwrap();
            assert_eq!(batch, [rows.clone(), rows].concat());
        }
        let q = vec![0.3; arm.dof()];
        assert!(
            (arm.jacobian_of(&q, &JacobianOf::default()).unwrap() - arm.jacobian(&q).unwrap()).amax() < 1e-15
        );
        let beyond = Some(arm.links().len());
        assert!(arm.jacobian_of(&q, &JacobianOf { link: beyond, ..Default::default() }).is_err());
    }
}

#[test]
fn rails_and_payloads_extend_a_chain() {
    let shift = redundancy_core::nalgebra::IsometryMatrix3::new(
        Vector3::new(0.1, 0.2, 0.3),
        Vector3::new(0.4, 0.5, -0.6),
    );
    let arm = catalog::load("iiwa14").unwrap().with_base(shift).unwrap();
    let axis = Vector3::new(0.0, 3.0, 4.0);
    let limits = Limits { lower: -0.5, upper: 2.0, velocity: 0.7, ..Limits::NONE };
    let railed = arm.with_rail("rail", axis, limits).unwrap();
    assert_eq!((railed.lower()[0], railed.upper()[0], railed.joints()[0].limits.velocity), (-0.5, 2.0, 0.7));
    assert_eq!(railed.links()[0].name, "rail_base");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..20 {
        let q = random_q(&mut rng, 8);
        let (on, off) = (railed.forward(&q).unwrap(), arm.forward(&q[1..]).unwrap());
        assert!((on.translation.vector - off.translation.vector - axis * (q[0] / 5.0)).norm() < 1e-14);
        assert!((on.rotation.matrix() - off.rotation.matrix()).amax() < 1e-15);
        let (a, b) = (railed.jacobian(&q).unwrap(), arm.jacobian(&q[1..]).unwrap());
        assert!((a.columns(1, 7) - b).amax() < 1e-14);
        assert!((a.fixed_view::<3, 1>(0, 0) - axis / 5.0).norm() < 1e-15);
        // The force that accelerates the rail: the mass of what the joints of the arm move.
        let mut scratch = DynamicsScratch::new(&railed);
        let mut tau = [0.0; 8];
        let mut qdd = [0.0; 8];
        qdd[0] = 1.0;
        railed.inverse_dynamics(&q, &[0.0; 8], &qdd, &Vector3::zeros(), &mut scratch, &mut tau).unwrap();
        let mass: f64 = arm.inertias().unwrap().iter().map(|body| body.mass).sum();
        assert!((tau[0] - mass).abs() < 1e-12);
    }
    let gantry = railed.with_rail("bridge", Vector3::x(), limits).unwrap();
    assert_eq!(
        gantry.links()[..3].iter().map(|l| l.name.as_str()).collect::<Vec<_>>(),
        ["bridge_base", "rail_base", arm.links()[0].name.as_str()]
    );
    for (refused, word) in [
        (railed.with_rail("rail", axis, limits), "'rail' is used twice"),
        (arm.with_rail("rail", Vector3::zeros(), limits), "length 0"),
        (arm.with_rail("rail", axis, Limits { lower: 1.0, upper: 0.0, ..limits }), "above upper limit"),
        (arm.with_payload(&Inertia::ZERO), "mass is 0"),
        (
            arm.with_payload(&Inertia {
                mass: 1.0,
                tensor: Matrix3::new(1.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
                ..Inertia::ZERO
            }),
            "asymmetry",
        ),
        (
            arm.with_payload(&Inertia {
                mass: 1.0,
                tensor: Matrix3::from_diagonal(&Vector3::new(1.0, -0.1, 1.0)),
                ..Inertia::ZERO
            }),
            "eigenvalue",
        ),
        (
            catalog::load("pa10").unwrap().with_payload(&Inertia { mass: 1.0, ..Inertia::ZERO }),
            "has no inertias",
        ),
    ] {
        let text = refused.unwrap_err().to_string();
        assert!(text.contains(word), "{text}");
    }
}
