use redundancy_core::Status;
use redundancy_core::nalgebra::{UnitQuaternion, Vector3};
use redundancy_core::rotation::*;

use super::Random;

fn settings(method: OrientationMethod) -> OrientationSettings {
    OrientationSettings { method, ..OrientationSettings::default() }
}

fn optimizer(barriers: &[Barrier], method: OrientationMethod) -> OrientationOptimizer {
    OrientationOptimizer::new(barriers.to_vec(), settings(method)).unwrap()
}

/// A direction at the angle `omega` from straight down.
fn off_down(omega: f64, azimuth: f64) -> [f64; 3] {
    [omega.sin() * azimuth.cos(), omega.sin() * azimuth.sin(), -omega.cos()]
}

/// The downward orientation with the frame's x axis turned to `psi`.
fn downward(psi: f64) -> UnitQuaternion<f64> {
    from_wxyz([0.0, 0.0, 1.0, 0.0]).unwrap() * from_zyz([psi, 0.0, 0.0])
}

/// Random problems of [FromGravdahl2009]: variant 1, 2 (x cone), 3 (spin).
fn problem(random: &mut Random, variant: usize) -> Vec<Barrier> {
    let beta = random.uniform(5.0, 45.0).to_radians();
    let alpha = random.uniform(20.0, 80.0).to_radians();
    let omega = random.uniform(0.0, 0.9) * (alpha + beta);
    let c = off_down(omega, random.uniform(-3.0, 3.0));
    let mut weight = || random.log_uniform(0.1, 10.0);
    let (k1, k2, k3) = (weight(), weight(), weight());
    let mut list = vec![
        Barrier::new(k1, Cone::downward(beta).unwrap()).unwrap(),
        Barrier::new(k2, Cone::z(c, alpha).unwrap()).unwrap(),
    ];
    let psi = random.uniform(-3.0, 3.0);
    let gamma = random.uniform(20.0, 80.0).to_radians();
    match variant {
        2 => {
            let b = downward(psi) * Vector3::x();
            list.push(Barrier::new(k3, Cone::x([b.x, b.y, b.z], gamma).unwrap()).unwrap());
        }
        3 => list.push(Barrier::new(k3, Spin::new(downward(psi), gamma, [0., 0., 1.]).unwrap()).unwrap()),
        _ => {}
    }
    list
}

fn cold() -> UnitQuaternion<f64> {
    from_wxyz([0., 0., 1., 0.]).unwrap()
}

fn deg(x: f64) -> f64 {
    x.to_radians()
}

/// Vectors computed independently of this library, by every method.
#[test]
fn vectors_computed_independently() {
    let c = [deg(30.).sin() * deg(40.).cos(), deg(30.).sin() * deg(40.).sin(), -deg(30.).cos()];
    let one = Barrier::new(1., Cone::downward(deg(20.)).unwrap()).unwrap();
    let two = Barrier::new(1., Cone::z(c, deg(60.)).unwrap()).unwrap();
    let qe = from_wxyz([0., deg(12.5).sin(), deg(12.5).cos(), 0.]).unwrap();
    let spin = Barrier::new(1., Spin::new(qe, deg(60.), [0., 0., 1.]).unwrap()).unwrap();
    let qd = from_wxyz([0.19826689127414618, 0., 0.9659258262890683, 0.16636567534280192]).unwrap();
    assert!((qd * Vector3::z() - Vector3::from(c)).norm() < 1e-10);
    let v1 = [0.024889869557, 0., 0.999472014521, 0.020885080365];
    let v3 = [0.019779521535, 0.216325336965, 0.975780537005, 0.025777174327];
    for method in [OrientationMethod::Auto, OrientationMethod::ClosedForm, OrientationMethod::Newton] {
        for q0 in [None, Some(cold())] {
            let s = optimizer(&[one, two], method).solve(q0.as_ref());
            for (a, b) in to_wxyz(&s.q).iter().zip(v1) {
                assert!((a - b).abs() < 1e-10, "{method:?} {:?}", to_wxyz(&s.q));
            }
            assert!((s.value - 5.154880775401105).abs() < 1e-12);
            let tilt = (-(s.q * Vector3::z()).z).acos().to_degrees();
            assert!((tilt - 3.7238975572).abs() < 1e-10, "{tilt}");
            let s = optimizer(&[one, two, spin], method).solve(q0.as_ref());
            for (a, b) in to_wxyz(&s.q).iter().zip(v3) {
                assert!((a - b).abs() < 1e-10, "{method:?} {:?}", to_wxyz(&s.q));
            }
            assert!((s.value - 6.253493064069).abs() < 1e-11);
        }
    }
    let fixed = OrientationSettings {
        method: OrientationMethod::Gradient,
        backtracking: false,
        ..Default::default()
    };
    for settings in [fixed, settings(OrientationMethod::Gradient)] {
        let s = OrientationOptimizer::new(vec![one, two], settings).unwrap().solve(Some(&cold()));
        assert_eq!(s.status, Status::Converged);
        for (a, b) in to_wxyz(&s.q).iter().zip(v1) {
            assert!((a - b).abs() < 1e-8, "{:?} after {}", to_wxyz(&s.q), s.iterations);
        }
        let s = OrientationOptimizer::new(vec![one, two, spin], settings).unwrap().solve(Some(&cold()));
        assert_eq!(s.status, Status::Converged);
        assert!((s.value - 6.253493064069).abs() < 1e-11);
    }
}

/// Newton's counts from the paper's cold start and from the feasible start, and the closed form beside it, on 10 000
/// problems of each variant.
#[test]
fn newton_needs_few_iterations_and_meets_the_closed_form() {
    for variant in 1..=3 {
        for start in [Some(cold()), None] {
            let mut random = Random::new(6 + variant as u64);
            let (mut counts, mut worst, mut infeasible) = (vec![], 0.0_f64, 0);
            for _ in 0..10_000 {
                let barriers = problem(&mut random, variant);
                let newton = optimizer(&barriers, OrientationMethod::Newton);
                let s = newton.solve(start.as_ref());
                if variant == 2 && s.status == Status::Infeasible {
                    infeasible += 1;
                    continue;
                }
                assert_eq!(s.status, Status::Converged);
                assert!(newton.margins(&s.q).all(|m| m > 0.0));
                let scale: f64 = barriers.iter().map(Barrier::weight).sum();
                assert!(s.gradient_norm < 1e-9 * scale, "{} V{variant}", s.gradient_norm);
                counts.push(s.iterations);
                if variant != 2 {
                    let c = optimizer(&barriers, OrientationMethod::ClosedForm).solve(start.as_ref());
                    worst = worst.max(rotation_angle(&c.q, &s.q));
                    assert!((c.value - s.value).abs() <= 1e-12 * s.value.abs().max(1.0));
                }
            }
            counts.sort_unstable();
            let (n, at) = (counts.len(), |p: usize| counts[(counts.len() - 1) * p / 100]);
            println!(
                "V{variant} from {}: {n} problems, median {}, 99 % {}, all {}; closed form within {worst:.1e}; \
                 infeasible {infeasible}",
                if start.is_some() { "cold" } else { "feasible" },
                at(50),
                at(99),
                counts[n - 1],
            );
            assert!(at(50) <= 5 && at(99) <= 10 && counts[n - 1] <= 25);
            assert!(worst < 1e-12 && infeasible < 20);
        }
    }
}

/// Every iterate is inside: the margins after each number of iterations are positive and the value falls.
#[test]
fn no_iterate_leaves_the_sets() {
    let mut random = Random::new(77);
    for n in 0..600 {
        let barriers = problem(&mut random, 1 + n % 3);
        for method in [OrientationMethod::Newton, OrientationMethod::Gradient] {
            let mut last = f64::INFINITY;
            for limit in 1..12 {
                let settings = OrientationSettings { max_iterations: Some(limit), ..settings(method) };
                let o = OrientationOptimizer::new(barriers.clone(), settings).unwrap();
                let s = o.solve(Some(&cold()));
                if s.status == Status::Infeasible {
                    break;
                }
                assert!(o.margins(&s.q).all(|m| m > 0.0));
                assert!(s.value <= last + 1e-12 * last.abs(), "{method:?} {limit}: {} after {last}", s.value);
                last = s.value;
                assert_eq!(s.status == Status::IterationLimit, s.status != Status::Converged);
            }
        }
    }
}

/// Cones of 0.01 and 89.9 degrees, gaps of 1e-9, weights over six decades.
#[test]
fn extremes() {
    let mut random = Random::new(9);
    let angles = [0.01, 0.1, 20.0, 89.9];
    for beta in angles {
        for alpha in angles {
            for share in [0.0, 1e-9, 0.5, 0.999, f64::NAN, f64::INFINITY] {
                let sum = deg(beta) + deg(alpha);
                // NaN and infinity stand for an overlap and a gap of 1e-9 rad.
                let omega = if share.is_nan() {
                    sum - 1e-9
                } else if share.is_finite() {
                    share * sum
                } else {
                    sum + 1e-9
                };
                for ratio in [1e-3, 1.0, 1e3] {
                    let barriers = [
                        Barrier::new(ratio, Cone::downward(deg(beta)).unwrap()).unwrap(),
                        Barrier::new(
                            1.0,
                            Cone::z(off_down(omega, random.uniform(-3., 3.)), deg(alpha)).unwrap(),
                        )
                        .unwrap(),
                    ];
                    let label = format!("beta {beta} alpha {alpha} omega {omega} ratio {ratio}");
                    let closed = optimizer(&barriers, OrientationMethod::ClosedForm).solve(None);
                    let newton = optimizer(&barriers, OrientationMethod::Newton).solve(None);
                    for s in [closed, newton] {
                        if share.is_infinite() {
                            assert_eq!(s.status, Status::Infeasible, "{label}");
                            assert!((s.miss_angle - 1e-9).abs() < 1e-14, "{label}: {:e}", s.miss_angle);
                        } else {
                            assert_eq!(s.status, Status::Converged, "{label} {s:?}");
                            assert!(barriers.iter().all(|b| b.constraint().margin(&s.q) > 0.0), "{label}");
                        }
                        assert!(s.q.coords.iter().all(|x| x.is_finite()));
                    }
                    let apart = (closed.q * Vector3::z() - newton.q * Vector3::z()).norm();
                    assert!(apart < 1e-12, "{label}: {apart:e} after {}", newton.iterations);
                    assert!(newton.iterations <= 25, "{label}: {}", newton.iterations);
                }
            }
        }
    }
}

/// The closed form against a dense scan of the arc: it is the minimum of the printed function.
#[test]
fn closed_form_is_the_minimum_on_the_sphere() {
    let mut random = Random::new(12);
    for _ in 0..100 {
        let barriers = problem(&mut random, 1);
        let o = optimizer(&barriers, OrientationMethod::ClosedForm);
        let best = o.solve(None);
        for _ in 0..2000 {
            let q = best.q
                * UnitQuaternion::from_scaled_axis(
                    Vector3::from(random.direction()) * random.log_uniform(1e-6, 2.0),
                );
            assert!(o.value(&q) >= best.value - 1e-12);
        }
    }
}

/// Wide cones: the closed form steps aside, and the best of many random starts is not better than what Newton finds.
#[test]
fn wide_cones_are_solved_globally() {
    let mut random = Random::new(15);
    for _ in 0..200 {
        let (beta, alpha) = (random.uniform(60., 179.), random.uniform(90., 179.));
        let (u, c) = (random.direction(), random.direction());
        let barriers = [
            Barrier::new(random.log_uniform(0.1, 10.), Cone::z(u, deg(beta)).unwrap()).unwrap(),
            Barrier::new(random.log_uniform(0.1, 10.), Cone::z(c, deg(alpha)).unwrap()).unwrap(),
        ];
        let o = optimizer(&barriers, OrientationMethod::ClosedForm);
        assert_eq!(o.method(), OrientationMethod::Newton);
        let s = o.solve(None);
        assert_eq!(s.status, Status::Converged);
        for _ in 0..3000 {
            assert!(o.value(&random.rotation()) >= s.value - 1e-12);
        }
    }
    // Opposite axes: a circle of minimisers; some member of it is returned.
    let barriers =
        [[0., 0., 1.], [0., 0., -1.]].map(|d| Barrier::new(1.0, Cone::z(d, deg(100.)).unwrap()).unwrap());
    let s = optimizer(&barriers, OrientationMethod::Auto).solve(None);
    assert!(s.status == Status::Converged && (s.q * Vector3::z()).z.abs() < 1e-9);
}

/// Three and more constraints, any axes: a start is found whenever one exists by construction.
#[test]
fn feasible_starts_are_found() {
    let mut random = Random::new(21);
    let mut worse = 0;
    for n in 0..2000 {
        // Sets that all contain a hidden orientation, by a small or large margin.
        let hidden = random.rotation();
        let mut barriers = vec![];
        for _ in 0..2 + n % 5 {
            let angle = random.uniform(2., 80.);
            let slack = random.log_uniform(1e-3, 0.9);
            let b = unit_direction("b", random.direction()).unwrap();
            let tilt = UnitQuaternion::from_scaled_axis(
                Vector3::from(random.direction()) * deg(angle) * (1.0 - slack),
            );
            let d = hidden * (tilt * b);
            let k = random.log_uniform(0.1, 10.);
            let cone = Cone::new(b.into_inner().into(), d.into_inner().into(), deg(angle)).unwrap();
            barriers.push(Barrier::new(k, cone).unwrap());
        }
        if n % 3 == 0 {
            let twist = UnitQuaternion::from_scaled_axis(Vector3::from(random.direction()) * 0.3);
            barriers.push(
                Barrier::new(1.0, Spin::new(hidden * twist, 0.5, random.direction()).unwrap()).unwrap(),
            );
        }
        assert!(barriers.iter().all(|b| b.constraint().margin(&hidden) > 0.0));
        let s = optimizer(&barriers, OrientationMethod::Auto).solve(None);
        assert_eq!(s.status, Status::Converged, "problem {n}: {s:?} {barriers:?}");
        let from_hidden = optimizer(&barriers, OrientationMethod::Newton).solve(Some(&hidden));
        worse += usize::from(s.value > from_hidden.value + 1e-9);
    }
    println!("{worse} of 2000 beaten from the hidden start");
    assert!(worse <= 2);
}

/// Infeasible sets say by how much: exact for pairs, and the returned orientation shares the miss.
#[test]
fn infeasible_sets_say_by_how_much() {
    let mut random = Random::new(22);
    for _ in 0..500 {
        let (beta, alpha) = (random.uniform(1., 40.), random.uniform(1., 40.));
        let miss = random.log_uniform(1e-6, 60.);
        let omega = deg(beta + alpha + miss);
        let two = [
            Barrier::new(1.0, Cone::downward(deg(beta)).unwrap()).unwrap(),
            Barrier::new(2.0, Cone::z(off_down(omega, 0.3), deg(alpha)).unwrap()).unwrap(),
        ];
        let spin = Barrier::new(1.0, Spin::new(downward(0.2), 0.5, [0., 0., 1.]).unwrap()).unwrap();
        for (barriers, method) in [
            (two.to_vec(), OrientationMethod::Auto),
            (two.to_vec(), OrientationMethod::Newton),
            (two.to_vec(), OrientationMethod::Gradient),
            (vec![two[0], two[1], spin], OrientationMethod::Auto),
        ] {
            let s = optimizer(&barriers, method).solve(None);
            assert_eq!(s.status, Status::Infeasible);
            assert!((s.miss_angle - deg(miss)).abs() < 1e-12, "{} {}", s.miss_angle, deg(miss));
            assert!(s.value == f64::INFINITY && s.iterations == 0);
            for b in &barriers[..2] {
                assert!((b.constraint().excess(&s.q) - 0.5 * deg(miss)).abs() < 1e-9);
            }
        }
        // Two different body axes: |phi_b - phi_d| - theta_1 - theta_2.
        let d = off_down(deg(20.), 0.4);
        let pair = [
            Barrier::new(1.0, Cone::downward(deg(10.)).unwrap()).unwrap(),
            Barrier::new(1.0, Cone::x(d, deg(15.)).unwrap()).unwrap(),
        ];
        let s = optimizer(&pair, OrientationMethod::Auto).solve(Some(&random.rotation()));
        assert_eq!(s.status, Status::Infeasible);
        assert!((s.miss_angle - deg(90. - 20. - 25.)).abs() < 1e-9, "{}", s.miss_angle.to_degrees());
    }
}

/// Along a path of slowly moving directions each solution, given the last one as `q0`, moves as little as they do.
#[test]
fn minimisers_are_continuous_along_a_path() {
    let mut random = Random::new(30);
    for case in 0..20 {
        let (a, b, e) = (random.direction(), random.direction(), random.direction());
        let step = 1e-3;
        let mut last: Option<UnitQuaternion<f64>> = None;
        for i in 0..3000 {
            let t = step * f64::from(i);
            let u = [a[0] + t.sin() * e[0], a[1] + t.sin() * e[1], a[2] - t * 0.3];
            let c = [u[0] + 0.3 * (3. * t).cos() * b[0], u[1] + 0.3 * t.sin(), u[2] + 0.3 * b[2]];
            let u_norm = Vector3::from(u).norm();
            if u_norm < 0.5 {
                break;
            }
            let barriers = match case % 3 {
                0 => vec![
                    Barrier::new(1., Cone::z(u, deg(30.)).unwrap()).unwrap(),
                    Barrier::new(2., Cone::z(c, deg(50.)).unwrap()).unwrap(),
                ],
                1 => vec![Barrier::new(1., Cone::z(u, deg(30.)).unwrap()).unwrap()],
                _ => vec![
                    Barrier::new(1., Cone::z(u, deg(60.)).unwrap()).unwrap(),
                    Barrier::new(2., Cone::new([0., 0.3, 1.], u, deg(50.)).unwrap()).unwrap(),
                ],
            };
            for method in [OrientationMethod::Auto, OrientationMethod::Newton] {
                let s = optimizer(&barriers, method).solve(last.as_ref());
                if s.status == Status::Infeasible {
                    continue;
                }
                if let Some(last) = &last {
                    let moved = (s.q.coords - last.coords).norm();
                    assert!(moved < 0.05, "case {case} step {i} {method:?}: moved {moved}");
                }
                last = Some(s.q);
            }
        }
    }
}

/// Without `q0`, with the normal fixed and pointing down: continuous in the wanted direction, sign included, and equal to
/// `swing(u -> z) * [0, 0, 1, 0]`.
#[test]
fn the_canonical_minimiser_is_continuous() {
    let down = Barrier::new(1.0, Cone::downward(deg(20.)).unwrap()).unwrap();
    let mut last: Option<UnitQuaternion<f64>> = None;
    for i in 0..20_000 {
        let t = 1e-3 * f64::from(i);
        let c = off_down(deg(40.) * t.sin(), 2.3 * t);
        let o = optimizer(
            &[down, Barrier::new(1.0, Cone::z(c, deg(60.)).unwrap()).unwrap()],
            OrientationMethod::Auto,
        );
        let s = o.solve(None);
        let u = unit_direction("u", [0., 0., -1.]).unwrap();
        let z = unit_direction("z", (s.q * Vector3::z()).into()).unwrap();
        assert!(((shortest_arc(&u, &z) * cold()).coords - s.q.coords).norm() < 1e-14);
        if let Some(last) = last {
            assert!((s.q.coords - last.coords).norm() < 2e-3);
        }
        last = Some(s.q);
    }
    // The nearest minimiser to q0: no rotation about the tool axis brings it closer.
    let mut random = Random::new(31);
    for _ in 0..200 {
        let barriers = problem(&mut random, 1);
        let q0 = random.rotation();
        for method in [OrientationMethod::Auto, OrientationMethod::Newton] {
            let s = optimizer(&barriers, method).solve(Some(&q0));
            for spin in [-1e-3, 1e-3] {
                let other = s.q * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin);
                assert!(rotation_angle(&other, &q0) >= rotation_angle(&s.q, &q0) - 1e-12);
            }
            assert!(s.q.coords.dot(&q0.coords) >= -1e-12);
        }
    }
}

#[test]
fn batches_equal_single_solutions_whatever_the_threads() {
    let mut random = Random::new(40);
    let n = 5000;
    let (mut normals, mut directions) = (vec![], vec![]);
    for _ in 0..n {
        normals.push(random.direction().map(|x| x * random.log_uniform(1e-8, 1e8)));
        directions.push(random.direction());
    }
    for cones in [
        DirectionCones { beta: deg(30.), alpha: deg(70.), k_err: 1.0, k_tcp: 0.3 },
        DirectionCones { beta: deg(30.), alpha: deg(110.), k_err: 1.0, k_tcp: 0.3 },
    ] {
        let run = |threads| {
            let (mut axes, mut status) = (vec![[0.0; 3]; n], vec![Status::Cancelled; n]);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| optimal_directions(&normals, &directions, &cones, &mut axes, &mut status))
                .unwrap();
            (axes, status)
        };
        let one = run(1);
        assert_eq!(one, run(2));
        assert_eq!(one, run(3));
        let mut infeasible = 0;
        for i in 0..n {
            let barriers = [
                Barrier::new(cones.k_err, Cone::z(normals[i], cones.beta).unwrap()).unwrap(),
                Barrier::new(cones.k_tcp, Cone::z(directions[i], cones.alpha).unwrap()).unwrap(),
            ];
            let s = optimizer(&barriers, OrientationMethod::Newton).solve(None);
            assert_eq!(s.status, one.1[i]);
            assert!((s.q * Vector3::z() - Vector3::from(one.0[i])).norm() < 1e-11, "row {i}");
            infeasible += usize::from(s.status == Status::Infeasible);
        }
        assert!(infeasible > 100 && infeasible < n - 100);
    }
    let cones = DirectionCones { beta: 0.3, alpha: 0.3, k_err: 1.0, k_tcp: 1.0 };
    let (mut axes, mut status) = ([[0.0; 3]; 2], [Status::Cancelled; 2]);
    let mut bad = |n: [[f64; 3]; 2], c: DirectionCones| {
        optimal_directions(&n, &[[0., 0., 1.]; 2], &c, &mut axes, &mut status).unwrap_err().to_string()
    };
    assert!(bad([[0., 0., 1.], [0.; 3]], cones).contains("normals, row 1"));
    assert!(bad([[f64::NAN; 3]; 2], cones).contains("NaN"));
    assert!(bad([[1.; 3]; 2], DirectionCones { alpha: 3.5, ..cones }).contains("alpha is 3.5"));
    assert!(bad([[1.; 3]; 2], DirectionCones { beta: -0.1, ..cones }).contains("beta is -0.1"));
    assert!(bad([[1.; 3]; 2], DirectionCones { k_err: -2., ..cones }).contains("k_err is -2"));
}

#[test]
fn bad_input_is_refused() {
    let new = |b: Vec<Barrier>, s| OrientationOptimizer::new(b, s).unwrap_err().to_string();
    let down = Barrier::new(1.0, Cone::downward(0.4).unwrap()).unwrap();
    let x = Barrier::new(1.0, Cone::x([1., 0., 0.], 0.4).unwrap()).unwrap();
    assert!(new(vec![], OrientationSettings::default()).contains("empty"));
    assert!(new(vec![down, x], settings(OrientationMethod::ClosedForm)).contains("one body axis"));
    let bad = OrientationSettings { step: Some(-1.0), ..Default::default() };
    assert!(new(vec![down], bad).contains("step is -1"));
    let bad = OrientationSettings { max_iterations: Some(0), ..Default::default() };
    assert!(new(vec![down], bad).contains("max_iterations"));
    assert!("secant".parse::<OrientationMethod>().unwrap_err().to_string().contains("newton"));
}

/// One constraint, and spins alone.
#[test]
fn single_constraints() {
    let mut random = Random::new(50);
    for _ in 0..200 {
        let (q0, reference) = (random.rotation(), random.rotation());
        let spin = Barrier::new(1.0, Spin::new(reference, 0.4, random.direction()).unwrap()).unwrap();
        let cone = Barrier::new(
            1.0,
            Cone::new(random.direction(), random.direction(), random.uniform(0.1, 3.0)).unwrap(),
        )
        .unwrap();
        for b in [spin, cone] {
            for method in [OrientationMethod::Auto, OrientationMethod::Newton] {
                for start in [None, Some(q0)] {
                    let s = optimizer(&[b], method).solve(start.as_ref());
                    assert_eq!(s.status, Status::Converged, "{b:?} {s:?} {method:?} {}", start.is_some());
                    assert!(
                        b.constraint().excess(&s.q)
                            + match b.constraint() {
                                Constraint::Cone(c) => c.half_angle(),
                                Constraint::Spin(s) => s.max_angle(),
                            }
                            < 1e-7
                    );
                }
            }
        }
        let closed = optimizer(&[spin], OrientationMethod::Auto);
        assert_eq!(closed.solve(None).q, reference);
    }
}

/// The gradient method with backtracking ends at the minimum of every variant, not where the value stops changing.
#[test]
fn the_gradient_method_arrives() {
    let mut random = Random::new(60);
    for n in 0..600 {
        let barriers = problem(&mut random, 1 + n % 3);
        let newton = optimizer(&barriers, OrientationMethod::Newton).solve(Some(&cold()));
        let gradient = optimizer(&barriers, OrientationMethod::Gradient).solve(Some(&cold()));
        assert_eq!(newton.status == Status::Infeasible, gradient.status == Status::Infeasible);
        if newton.status == Status::Infeasible {
            continue;
        }
        assert_eq!(gradient.status, Status::Converged, "{n}: {gradient:?} {newton:?}");
        // The local minimum under the same start; a variant with an x cone may have several.
        if n % 3 != 1 {
            assert!((gradient.value - newton.value).abs() < 1e-9, "{n}");
        }
    }
}

/// Nothing allocates per solve, whatever the method and the start.
#[test]
fn solving_allocates_nothing() {
    let mut random = Random::new(70);
    for n in 0..300 {
        let barriers = problem(&mut random, 1 + n % 3);
        for method in [OrientationMethod::Auto, OrientationMethod::Newton, OrientationMethod::Gradient] {
            let o = optimizer(&barriers, method);
            let mut margins = [0.0; 3];
            for q0 in [None, Some(cold())] {
                let allocations = crate::allocations::count(|| {
                    let s = o.solve(q0.as_ref());
                    margins.iter_mut().zip(o.margins(&s.q)).for_each(|(slot, m)| *slot = m);
                });
                assert_eq!(allocations, 0, "{method:?}, problem {n}");
            }
        }
    }
}

/// Seven fixed steps against the paper's iteration written out: the ambient gradient by central differences of the
/// printed function of an unnormalised quaternion, its tangential part, `Q - a grad`, normalised.
#[test]
fn fixed_steps_are_the_papers() {
    use redundancy_core::nalgebra::{Quaternion, Vector4};
    let mut random = Random::new(80);
    for n in 0..60 {
        let barriers = problem(&mut random, 1 + n % 3);
        let start = optimizer(&barriers, OrientationMethod::Auto).solve(None);
        if start.status != Status::Converged {
            continue;
        }
        let q0 = start.q * UnitQuaternion::from_scaled_axis(Vector3::from(random.direction()) * 1e-2);
        let value = |v: Vector4<f64>| -> f64 {
            let q = UnitQuaternion::new_normalize(Quaternion::from_vector(v));
            barriers.iter().map(|b| b.value(&q)).sum()
        };
        if !value(q0.coords).is_finite() {
            continue;
        }
        let step = 1e-4;
        let mut v = q0.coords;
        for _ in 0..7 {
            let e = 1e-6;
            let gradient = Vector4::from_fn(|i, _| {
                let d = Vector4::ith(i, e);
                (value(v + d) - value(v - d)) / (2.0 * e)
            });
            v = (v - gradient * step).normalize();
        }
        let settings = OrientationSettings {
            backtracking: false,
            step: Some(step),
            max_iterations: Some(7),
            ..settings(OrientationMethod::Gradient)
        };
        let s = OrientationOptimizer::new(barriers.clone(), settings).unwrap().solve(Some(&q0));
        let expected = UnitQuaternion::new_normalize(Quaternion::from_vector(v));
        // On one body axis only the axis is determined; the spin is the one nearest to q0.
        let (a, b) = (s.q * Vector3::z(), expected * Vector3::z());
        assert!((a - b).norm() < 1e-8, "{n}: {}", (a - b).norm());
        if barriers.len() == 3 {
            assert!(rotation_angle(&s.q, &expected) < 1e-8, "{n}: {}", rotation_angle(&s.q, &expected));
        }
    }
}
