//! The builder, D-H rows and the changes that make new chains.

use std::f64::consts::{FRAC_PI_2, PI};

use redundancy_core::chain::{Chain, ChainBuilder, DhConvention, DhRow, Inertia, JointKind, Limits, catalog};
use redundancy_core::nalgebra::{Matrix3, Rotation3, Translation3, Vector3};
use redundancy_core::{Error, Pose};

fn rows() -> Vec<DhRow> {
    let row = |a, d, alpha, theta| DhRow { a, d, alpha, theta };
    vec![row(0.3, 0.1, FRAC_PI_2, 0.4), row(-0.2, 0.0, 0.7, -1.0), row(0.0, 0.5, -2.0, 0.0)]
}

fn moved(x: f64, y: f64, z: f64) -> Pose {
    Pose::from_parts(Translation3::new(x, y, z), Rotation3::identity())
}

fn turned(axis: Vector3<f64>, angle: f64) -> Pose {
    Pose::from_parts(Translation3::identity(), Rotation3::new(axis * angle))
}

/// Both conventions against their definition, every frame.
#[test]
fn dh_rows_follow_their_definition() {
    let q = [0.3, -1.2, 2.5];
    for convention in [DhConvention::Standard, DhConvention::Modified] {
        let arm = ChainBuilder::from_dh("arm", &rows(), convention).build().unwrap();
        let mut expected = Pose::identity();
        for (i, (row, q)) in rows().iter().zip(q).enumerate() {
            let about_z = turned(Vector3::z(), row.theta + q) * moved(0.0, 0.0, row.d);
            let about_x = moved(row.a, 0.0, 0.0) * turned(Vector3::x(), row.alpha);
            expected *= match convention {
                DhConvention::Standard => about_z * about_x,
                DhConvention::Modified => about_x * about_z,
            };
            let link = arm.link_index(&format!("link{}", i + 1)).unwrap();
            let found = arm.forward_link(&[0.3, -1.2, 2.5], link).unwrap();
            assert!((found.to_homogeneous() - expected.to_homogeneous()).amax() < 1e-15);
        }
        assert!((arm.forward(&q).unwrap().to_homogeneous() - expected.to_homogeneous()).amax() < 2e-15);
    }
}

#[test]
fn right_angles_in_dh_rows_are_exact() {
    for quarter in -4..=4 {
        let row = DhRow { a: 0.0, d: 0.0, alpha: f64::from(quarter) * FRAC_PI_2, theta: 0.0 };
        let arm = ChainBuilder::from_dh("arm", &[row], DhConvention::Standard).build().unwrap();
        let pose = arm.forward(&[0.0]).unwrap();
        assert!(pose.rotation.matrix().iter().all(|v| [0.0, 1.0, -1.0].contains(v)), "{quarter}");
        let exact = turned(Vector3::x(), f64::from(quarter) * FRAC_PI_2);
        assert!((pose.to_homogeneous() - exact.to_homogeneous()).amax() < 1e-15);
    }
    assert_eq!(90_f64.to_radians(), FRAC_PI_2);
    assert_eq!(180_f64.to_radians(), PI);
}

#[test]
fn link_inertias_move_into_the_frame_of_the_joint() {
    let body = Inertia {
        mass: 2.0,
        center_of_mass: Vector3::new(0.1, 0.2, 0.3),
        tensor: Matrix3::new(0.3, 0.01, 0.02, 0.01, 0.4, 0.03, 0.02, 0.03, 0.5),
        rotor: 0.7,
    };
    let row = DhRow { a: 1.0, d: 0.5, alpha: FRAC_PI_2, theta: 0.0 };
    let build = |convention| {
        let arm = ChainBuilder::from_dh("arm", &[row], convention).link_inertias(&[body]).build().unwrap();
        arm.inertias().unwrap()[0]
    };
    // modified: the frame of the row is the frame that the joint moves
    assert_eq!(build(DhConvention::Modified), body);
    // standard: it sits at the far end of the link: x = x + 1, y = -z, z = y + 0.5
    let far = build(DhConvention::Standard);
    assert!((far.center_of_mass - Vector3::new(1.1, -0.3, 0.7)).norm() < 1e-15);
    assert_eq!((far.mass, far.rotor), (2.0, 0.7));
    assert!((far.tensor[(1, 1)], far.tensor[(2, 2)]) == (0.5, 0.4) && far.tensor[(0, 1)] == -0.02);
}

#[test]
fn what_is_wrong_is_named() {
    let one = || {
        ChainBuilder::new("arm", "base").joint(
            "j",
            JointKind::Revolute,
            Pose::identity(),
            Vector3::z(),
            Limits::NONE,
        )
    };
    let two =
        |name: &str| one().joint(name, JointKind::Revolute, Pose::identity(), Vector3::z(), Limits::NONE);
    let limited = |limits| one().limits(&[limits]).build();
    let with_axis = |axis| {
        ChainBuilder::new("arm", "base")
            .joint("j", JointKind::Revolute, Pose::identity(), axis, Limits::NONE)
            .build()
    };
    let skewed = Pose::from_parts(
        Translation3::identity(),
        Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 3e-3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
    );
    let mirror = Pose::from_parts(
        Translation3::identity(),
        Rotation3::from_matrix_unchecked(Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0))),
    );
    let heavy = |mass, rotor| Inertia { mass, rotor, ..Inertia::ZERO };
    let nan = f64::NAN;
    let inf = f64::INFINITY;
    let dh = |d| {
        ChainBuilder::from_dh("arm", &[DhRow { a: 0.0, d, alpha: 0.0, theta: 0.0 }], DhConvention::Standard)
    };
    let table: Vec<(Result<Chain, Error>, &[&str])> = vec![
        (ChainBuilder::new("arm", "base").build(), &["'arm'", "no moving joint"]),
        (two("j").build(), &["joint", "'j'", "twice"]),
        (one().link("base", Pose::identity()).build(), &["link", "'base'", "twice"]),
        (with_axis(Vector3::zeros()), &["'j'", "axis", "length 0"]),
        (with_axis(Vector3::new(0.0, nan, 1.0)), &["'j'", "axis", "entry 1", "NaN"]),
        (one().base(skewed).build(), &["base", "orthonormal", "0.0015", "1e-3"]),
        (one().tool(mirror).build(), &["tool", "reflection", "-1"]),
        (one().tool(moved(inf, 0.0, 0.0)).build(), &["tool", "inf", "finite"]),
        (limited(Limits { lower: 1.0, upper: -1.0, ..Limits::NONE }), &["'j'", "1", "above", "-1"]),
        (limited(Limits { lower: nan, ..Limits::NONE }), &["'j'", "NaN"]),
        (limited(Limits { velocity: 0.0, ..Limits::NONE }), &["'j'", "velocity", "0", "> 0"]),
        (limited(Limits { effort: -2.0, ..Limits::NONE }), &["'j'", "effort", "-2", "> 0"]),
        (limited(Limits { acceleration: nan, ..Limits::NONE }), &["'j'", "acceleration", "NaN"]),
        (one().limits(&[]).build(), &["limits", "expected 1", "got 0"]),
        (one().joint_names(["a", "b"]).build(), &["joint names", "expected 1", "got 2"]),
        (one().link_names(["a", "b"]).build(), &["link names", "expected 1", "got 2"]),
        (one().link_inertias(&[]).build(), &["inertias", "expected 1", "got 0"]),
        (one().inertias(vec![]).build(), &["inertias", "expected 1", "got 0"]),
        (one().inertias(vec![heavy(-1.0, 0.0)]).build(), &["j", "mass", "-1", ">= 0"]),
        (one().inertias(vec![heavy(1.0, nan)]).build(), &["j", "rotor", "NaN"]),
        (dh(nan).build(), &["D-H row 0", "entry 1", "NaN"]),
        (ChainBuilder::from_dh("arm", &[], DhConvention::Standard).build(), &["no moving joint"]),
        (catalog::load("pa11"), &["pa11", "dexter, fr3, gen3"]),
    ];
    for (result, words) in table {
        let text = result.unwrap_err().to_string();
        for word in words {
            assert!(text.contains(word), "'{text}' lacks '{word}'");
        }
    }
}

#[test]
fn changes_make_new_chains() {
    let arm = catalog::load("pa10").unwrap();
    let q = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
    let tip = arm.forward(&q).unwrap();
    let (tool, base) = (moved(0.0, 0.1, 0.2), turned(Vector3::x(), 0.3));
    let tooled = arm.with_tool(tool).unwrap();
    assert!((tooled.forward(&q).unwrap().to_homogeneous() - (tip * tool).to_homogeneous()).amax() < 1e-15);
    assert_eq!(tooled.with_tool(tool).unwrap(), tooled); // replaces, does not add
    let based = arm.with_base(base).unwrap();
    assert!((based.forward(&q).unwrap().to_homogeneous() - (base * tip).to_homogeneous()).amax() < 1e-15);
    assert_eq!(based.with_base(Pose::identity()).unwrap(), arm);
    // links move with the base, not with the tool
    let link = arm.link_index("flange").unwrap();
    assert_eq!(tooled.forward_link(&q, link).unwrap(), arm.forward_link(&q, link).unwrap());
    let mut limits: Vec<Limits> = arm.joints().iter().map(|j| j.limits).collect();
    limits[3].upper = 1.0;
    let limited = arm.with_limits(&limits).unwrap();
    assert_eq!((limited.upper()[3], arm.upper()[3]), (1.0, 137_f64.to_radians()));
    assert_ne!(limited, arm);
    limits[3].lower = 2.0;
    assert!(matches!(arm.with_limits(&limits), Err(Error::InvertedLimits { joint, .. }) if joint == "E1"));
    assert!(matches!(arm.with_limits(&limits[1..]), Err(Error::Length { expected: 7, actual: 6, .. })));
}

#[test]
fn a_continuous_joint_with_limits_is_revolute() {
    let arm = ChainBuilder::new("arm", "base")
        .joint("j", JointKind::Continuous, Pose::identity(), Vector3::z(), Limits::NONE)
        .build()
        .unwrap();
    let same = arm.with_limits(&[Limits { velocity: 1.0, ..Limits::NONE }]).unwrap();
    assert_eq!(same.joints()[0].kind, JointKind::Continuous);
    let limited = arm.with_limits(&[Limits { lower: -1.0, upper: 1.0, ..Limits::NONE }]).unwrap();
    assert_eq!((limited.joints()[0].kind, limited.lower()[0]), (JointKind::Revolute, -1.0));
}
