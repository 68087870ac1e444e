//! URDF: what is read, what is refused, and that no text at all makes it panic.

use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use redundancy_core::Error;
use redundancy_core::chain::{Chain, JointKind, MissingLimits};
use redundancy_core::nalgebra::{Matrix3, Vector3};

const ARM: &str = include_str!("../data/arm.urdf");

fn read(xml: &str, base: &str, tip: &str) -> Result<Chain, Error> {
    Chain::from_urdf_string(xml, Some(base), Some(tip), MissingLimits::Refuse)
}

fn arm() -> Chain {
    read(ARM, "world", "flange").unwrap()
}

/// A chain a -> b with one joint made of `inside`.
fn one_joint(kind: &str, inside: &str) -> String {
    format!(
        r#"<robot name="r"><link name="a"/><link name="b"/>
        <joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{inside}</joint></robot>"#
    )
}

fn message(xml: &str) -> String {
    read(xml, "a", "b").unwrap_err().to_string()
}

#[test]
fn joints_and_links_in_order() {
    let arm = arm();
    assert_eq!(arm.name(), "lifter");
    let joints: Vec<_> = arm.joints().iter().map(|j| (j.name.as_str(), j.kind)).collect();
    use JointKind::{Continuous, Prismatic, Revolute};
    assert_eq!(
        joints,
        [
            ("lift", Prismatic),
            ("turn", Continuous),
            ("raise", Revolute),
            ("elbow", Revolute),
            ("roll", Revolute)
        ]
    );
    let links: Vec<_> = arm.links().iter().map(|l| (l.name.as_str(), l.joints_before)).collect();
    let expected = [
        ("world", 0),
        ("base_link", 0),
        ("mast", 1),
        ("shoulder", 2),
        ("upper_arm", 3),
        ("forearm", 4),
        ("wrist", 5),
        ("flange", 5),
    ];
    assert_eq!(links, expected);
}

#[test]
fn limits_and_their_absence() {
    let arm = arm();
    let limits: Vec<_> = arm.joints().iter().map(|j| j.limits).collect();
    assert_eq!(
        (limits[0].lower, limits[0].upper, limits[0].velocity, limits[0].effort),
        (0.0, 0.8, 0.2, 500.0)
    );
    // continuous: no positions; velocity and effort 0: none
    assert_eq!((limits[1].lower, limits[1].upper), (f64::NEG_INFINITY, f64::INFINITY));
    assert_eq!((limits[1].velocity, limits[1].effort), (2.0, 80.0));
    assert_eq!(limits[2].effort, f64::INFINITY);
    assert_eq!(limits[3].velocity, f64::INFINITY);
    assert!(limits.iter().all(|l| l.acceleration == f64::INFINITY));
}

#[test]
fn numbers_are_never_snapped() {
    // rpy = -1.5707963 is 2.7e-8 away from a right angle and stays there
    let arm = arm();
    let placement = &arm.joints()[2].placement;
    let written: f64 = "-1.5707963".parse().unwrap();
    assert_eq!(placement.rotation[(1, 1)], written.cos());
    assert!(placement.rotation[(1, 1)] > 2e-8);
}

#[test]
fn defaults_of_the_format() {
    // no origin: identity; no axis: x
    let xml = one_joint("revolute", r#"<limit lower="-1" upper="1" velocity="1" effort="1"/>"#);
    let chain = read(&xml, "a", "b").unwrap();
    assert_eq!(chain.joints()[0].axis.into_inner(), Vector3::x());
    assert_eq!(chain.forward(&[0.0]).unwrap(), redundancy_core::Pose::identity());
    // no lower, upper: 0; no velocity, effort: none
    let chain = read(&one_joint("revolute", "<limit/>"), "a", "b").unwrap();
    let l = chain.joints()[0].limits;
    assert_eq!((l.lower, l.upper, l.velocity, l.effort), (0.0, 0.0, f64::INFINITY, f64::INFINITY));
    // URDF 1.2: no lower, upper: none; acceleration exists
    let xml =
        one_joint("revolute", r#"<limit acceleration="3"/>"#).replace("<robot", r#"<robot version="1.2""#);
    let l = read(&xml, "a", "b").unwrap().joints()[0].limits;
    assert_eq!((l.lower, l.upper, l.acceleration), (f64::NEG_INFINITY, f64::INFINITY, 3.0));
    // ... before 1.2 it does not
    let xml = one_joint("revolute", r#"<limit acceleration="3"/>"#);
    assert_eq!(read(&xml, "a", "b").unwrap().joints()[0].limits.acceleration, f64::INFINITY);
}

#[test]
fn quaternions_of_urdf_1_1_keep_their_digits() {
    // pitch 89.9 deg: as roll, pitch, yaw the way urdf-rs does it, the rotation would be off by 1.7e-3 rad
    let (s, c) = (89.9_f64.to_radians() / 2.0).sin_cos();
    let inside = format!(r#"<origin quat_xyzw="0 {s} 0 {c}"/><limit lower="-1" upper="1"/>"#);
    let xml = one_joint("revolute", &inside);
    let pose = |xml: &str| read(xml, "a", "b").unwrap().forward(&[0.0]).unwrap();
    let at = pose(&xml.replace("<robot", r#"<robot version="1.1""#));
    assert!((at.rotation[(0, 0)] - 89.9_f64.to_radians().cos()).abs() < 1e-15);
    assert_eq!(pose(&xml), redundancy_core::Pose::identity()); // 1.0 ignores it
    let long = xml.replace("<robot", r#"<robot version="1.1""#).replace("quat_xyzw=\"0", "quat_xyzw=\"1");
    assert!(matches!(read(&long, "a", "b"), Err(Error::NotUnit { .. })));
}

#[test]
fn inertia_of_fixed_links_is_folded() {
    let arm = arm();
    let bodies = arm.inertias().unwrap();
    assert_eq!(bodies.len(), 5);
    // mast and the camera that is fixed to it; not the base below, not the shoulder above
    assert!((bodies[0].mass - 6.9).abs() < 1e-15);
    let (s, c) = 0.4_f64.sin_cos();
    let camera = Vector3::new(0.05 + 0.02 * s, 0.0, 0.9 + 0.02 * c);
    let center = (Vector3::new(0.01, 0.0, 0.4) * 6.5 + camera * 0.4) / 6.9;
    assert!((bodies[0].center_of_mass - center).norm() < 1e-15);
    let parallel = |m: f64, d: Vector3<f64>| m * (d.norm_squared() * Matrix3::identity() - d * d.transpose());
    let turned = |r: Matrix3<f64>, t: Matrix3<f64>| r * t * r.transpose();
    let rx = *redundancy_core::nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), 0.1).matrix();
    let ry = *redundancy_core::nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), 0.4).matrix();
    let mast = Matrix3::new(0.3, 0.001, -0.002, 0.001, 0.31, 0.003, -0.002, 0.003, 0.05);
    let expected = turned(rx, mast)
        + parallel(6.5, Vector3::new(0.01, 0.0, 0.4) - center)
        + turned(ry, Matrix3::from_diagonal(&Vector3::new(0.001, 0.002, 0.0015)))
        + parallel(0.4, camera - center);
    assert!((bodies[0].tensor - expected).amax() < 1e-15);
    assert_eq!(bodies[1].mass, 0.0); // the shoulder has no inertial
    assert_eq!(bodies[4].mass, 0.0); // fingers hang on joints of their own
    // none at all: no inertias
    let xml = one_joint("continuous", "");
    assert!(read(&xml, "a", "b").unwrap().inertias().is_none());
}

#[test]
fn base_and_tip_may_be_left_out() {
    let free = |base: Option<&str>, tip: Option<&str>| {
        Chain::from_urdf_string(ARM, base, tip, MissingLimits::Refuse).map(|c| c.dof())
    };
    assert_eq!(free(None, Some("flange")), Ok(5));
    assert_eq!(free(None, Some("finger_left")), Ok(6));
    assert_eq!(free(Some("mast"), Some("flange")), Ok(4));
    let leaves = free(None, None).unwrap_err().to_string();
    assert!(leaves.contains("several leaves: camera, finger_left, finger_right"), "{leaves}");
    let xml = one_joint("continuous", "");
    let one = Chain::from_urdf_string(&xml, None, None, MissingLimits::Refuse).unwrap();
    assert_eq!(one.dof(), 1);
    let roots = xml.replace("</robot>", "<link name=\"c\"/></robot>");
    let error = Chain::from_urdf_string(&roots, None, None, MissingLimits::Refuse).unwrap_err().to_string();
    assert!(error.contains("several roots: a, c"), "{error}");
}

#[test]
fn missing_limits() {
    for kind in ["revolute", "prismatic"] {
        let xml = one_joint(kind, "");
        let refused = message(&xml);
        assert!(refused.contains("'j'") && refused.contains("no <limit>"), "{refused}");
        let free = Chain::from_urdf_string(&xml, None, None, MissingLimits::Unbounded).unwrap();
        let l = free.joints()[0].limits;
        assert_eq!((l.lower, l.upper, l.velocity), (f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY));
    }
}

/// Every kind of bad input: what is broken, and the words that the message must contain.
#[test]
fn bad_input_is_named() {
    let limit = r#"<limit lower="-1" upper="1" velocity="1" effort="1"/>"#;
    let revolute = |inside: &str| one_joint("revolute", &format!("{inside}{limit}"));
    let table: Vec<(String, &[&str])> = vec![
        ("".into(), &["XML"]),
        ("hello".into(), &["XML"]),
        ("<robot".into(), &["XML"]),
        ("<robot name='r'><link name='a'></robot>".into(), &["XML", "link"]),
        ("<sdf/>".into(), &["<sdf>", "<robot>"]),
        ("<robot/>".into(), &["no <link>"]),
        ("<robot xmlns:xacro='x'><xacro:arm/></robot>".into(), &["no <link>", "xacro"]),
        ("<robot><link/></robot>".into(), &["link 0", "no name"]),
        ("<robot><link name=''/></robot>".into(), &["link 0", "empty"]),
        ("<robot><link name='a'/><link name='a'/></robot>".into(), &["'a'", "twice"]),
        (revolute("").replace("type=\"revolute\"", ""), &["'j'", "no type"]),
        (one_joint("hinge", ""), &["'j'", "'hinge'", "prismatic"]),
        (one_joint("floating", ""), &["'j'", "floating"]),
        (one_joint("planar", ""), &["'j'", "planar"]),
        (revolute("<mimic joint='k'/>"), &["'j'", "mimic"]),
        (revolute("").replace("<child link=\"b\"/>", ""), &["'j'", "no <child>"]),
        (revolute("").replace("<child link=\"b\"/>", "<child/>"), &["'j'", "<child>", "no link"]),
        (
            revolute("").replace("<child link=\"b\"/>", "<child link=\"z\"/>"),
            &["'j'", "<child>", "'z'", "a, b"],
        ),
        (revolute("").replace("parent link=\"a\"", "parent link=\"q\""), &["'j'", "<parent>", "'q'", "a, b"]),
        (revolute("<axis xyz='0 0 0'/>"), &["'j'", "axis", "length"]),
        (revolute("<axis xyz='1e-12 0 0'/>"), &["'j'", "axis", "length"]),
        (revolute("<axis xyz='0 nan 1'/>"), &["'j'", "axis", "entry 1", "NaN", "finite"]),
        (revolute("<axis xyz='0 1'/>"), &["'j'", "axis", "'0 1'", "3 numbers"]),
        (revolute("<axis xyz='0 0 1 0'/>"), &["'j'", "axis", "3 numbers"]),
        (revolute("<axis xyz='0 0 up 1'/>"), &["'j'", "axis", "3 numbers"]),
        (revolute("<axis xyz='0 0 up'/>"), &["'j'", "axis", "'up'"]),
        (revolute("<origin xyz='inf 0 0'/>"), &["'j'", "origin xyz", "inf"]),
        (revolute("<origin xyz='1e999 0 0'/>"), &["'j'", "origin xyz", "inf"]),
        (revolute("<origin rpy='0,0,0'/>"), &["'j'", "origin rpy", "'0,0,0'"]),
        (one_joint("revolute", "<limit lower='2' upper='1'/>"), &["'j'", "2", "1", "above"]),
        (one_joint("revolute", "<limit lower='0.5'/>"), &["'j'", "0.5", "above"]),
        (one_joint("revolute", "<limit lower='nan' upper='1'/>"), &["'j'", "lower", "nan"]),
        (one_joint("revolute", "<limit lower='0' upper='1 2'/>"), &["'j'", "upper", "1 2"]),
        (one_joint("revolute", "<limit upper='1' velocity='-1'/>"), &["'j'", "velocity", "-1"]),
        (one_joint("revolute", "<limit upper='1' effort='-5'/>"), &["'j'", "effort", "-5"]),
        (one_joint("revolute", "<limit lower='inf' upper='inf'/>"), &["'j'", "lower", "inf"]),
        (
            revolute("").replace(
                "<link name=\"b\"/>",
                "<link name=\"b\"><inertial><mass value='1'/></inertial></link>",
            ),
            &["'b'", "<inertia>"],
        ),
        (
            revolute("").replace(
                "<link name=\"b\"/>",
                "<link name=\"b\"><inertial><mass value='-1'/><inertia/></inertial></link>",
            ),
            &["'b'", "mass", "-1"],
        ),
        (
            revolute("").replace(
                "<link name=\"b\"/>",
                "<link name=\"b\"><inertial><mass value='1'/><inertia ixx='1'/></inertial></link>",
            ),
            &["'b'", "inertia", "ixy"],
        ),
        (one_joint("fixed", ""), &["no moving joint"]),
    ];
    for (xml, words) in &table {
        let text = message(xml);
        for word in *words {
            assert!(text.contains(word), "'{text}' lacks '{word}' for {xml}");
        }
    }
}

#[test]
fn bad_ways_are_named() {
    let unknown = read(ARM, "word", "flange").unwrap_err();
    assert!(
        matches!(&unknown, Error::UnknownName { kind: "link", name, valid } if name == "word" && valid.len() == 11)
    );
    let islands = ARM.replacen("<link name=\"world\"/>", "<link name=\"world\"/><link name=\"island\"/>", 1);
    let text = read(&islands, "island", "flange").unwrap_err().to_string();
    for part in [
        "no way from base 'island' to tip 'flange'",
        "above 'island' is 'island'",
        "above 'flange' is 'world'",
    ] {
        assert!(text.contains(part), "{text}");
    }
    let text = read(ARM, "shoulder", "turn").unwrap_err().to_string();
    assert!(text.contains("unknown link 'turn'"), "{text}");
    let leaf = Chain::from_urdf_string(ARM, Some("camera"), None, MissingLimits::Refuse).unwrap_err();
    assert!(leaf.to_string().contains("no link is below base 'camera'"), "{leaf}");
    let text = read(ARM, "mast", "mast").unwrap_err().to_string();
    assert!(text.contains("same link 'mast'"), "{text}");
    let text = read(ARM, "world", "finger_right").unwrap_err().to_string();
    assert!(text.contains("'right' mimics"), "{text}");
    // cycles, two parents, joint names used twice
    let link = |n: &str| format!("<link name='{n}'/>");
    let joint = |n: &str, p: &str, c: &str| {
        format!("<joint name='{n}' type='continuous'><parent link='{p}'/><child link='{c}'/></joint>")
    };
    let robot = |parts: &[String]| format!("<robot name='r'>{}</robot>", parts.concat());
    let links = [link("a"), link("b"), link("c")].concat();
    let cycle = robot(&[links.clone(), joint("j", "b", "c"), joint("k", "c", "b")]);
    for (base, tip) in [(None, Some("c")), (Some("a"), Some("c")), (Some("b"), None)] {
        let text = Chain::from_urdf_string(&cycle, base, tip, MissingLimits::Refuse).unwrap_err().to_string();
        assert!(text.contains("cycle"), "{text}");
    }
    let ring = robot(&[link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")]);
    let text = Chain::from_urdf_string(&ring, None, None, MissingLimits::Refuse).unwrap_err().to_string();
    assert!(text.contains("cycle"), "{text}");
    let own = robot(&[link("a"), joint("j", "a", "a")]);
    assert!(Chain::from_urdf_string(&own, None, None, MissingLimits::Refuse).is_err());
    let diamond = robot(&[links.clone(), joint("j", "a", "c"), joint("k", "b", "c")]);
    let text = read(&diamond, "a", "c").unwrap_err().to_string();
    assert!(text.contains("'c' is the child of two joints, 'j' and 'k'"), "{text}");
    let twice = robot(&[links, joint("j", "a", "b"), joint("j", "b", "c")]);
    let text = read(&twice, "a", "c").unwrap_err().to_string();
    assert!(text.contains("joint name 'j' is used twice"), "{text}");
    assert!(read(&twice, "a", "b").is_ok()); // outside of the chain it harms nobody
}

/// The way up the tree and down again against the ways from the root.
#[test]
fn chains_run_over_the_common_ancestor() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let value = |chain: &Chain, q: &[f64], joint: &str| {
        chain.joints().iter().position(|j| j.name == joint).map(|i| q[i])
    };
    for (base, tip, names) in [
        ("camera", "flange", vec!["turn", "raise", "elbow", "roll"]),
        ("flange", "world", vec!["roll", "elbow", "raise", "turn", "lift"]),
        ("forearm", "camera", vec!["elbow", "raise", "turn"]),
        ("wrist", "base_link", vec!["roll", "elbow", "raise", "turn", "lift"]),
        ("finger_left", "camera", vec!["left", "roll", "elbow", "raise", "turn"]),
    ] {
        let chain = read(ARM, base, tip).unwrap();
        let joints: Vec<&str> = chain.joints().iter().map(|j| j.name.as_str()).collect();
        assert_eq!(joints, names);
        assert_eq!(
            (chain.links()[0].name.as_str(), chain.links().last().unwrap().name.as_str()),
            (base, tip)
        );
        let whole = Chain::from_urdf_string(ARM, None, Some("finger_left"), MissingLimits::Refuse).unwrap();
        for joint in chain.joints() {
            let same = whole.joints().iter().find(|other| other.name == joint.name).unwrap();
            assert_eq!((joint.kind, joint.limits), (same.kind, same.limits));
        }
        for _ in 0..20 {
            let q: Vec<f64> = (0..chain.dof()).map(|_| rng.random_range(-2.0..2.0)).collect();
            let from_root = |link: &str| {
                let Ok(way) = Chain::from_urdf_string(ARM, None, Some(link), MissingLimits::Refuse) else {
                    // The root itself, and what is fixed to it.
                    let fix = whole.forward_link(&[0.0; 6], whole.link_index(link).unwrap()).unwrap();
                    return fix;
                };
                let own: Vec<f64> =
                    way.joints().iter().map(|j| value(&chain, &q, &j.name).unwrap_or(0.0)).collect();
                way.forward(&own).unwrap()
            };
            let expected = from_root(base).inv_mul(&from_root(tip));
            let pose = chain.forward(&q).unwrap();
            assert!((pose.to_homogeneous() - expected.to_homogeneous()).amax() < 1e-14, "{base} {tip}");
            for (i, link) in chain.links().iter().enumerate() {
                let expected = from_root(base).inv_mul(&from_root(&link.name));
                let pose = chain.forward_link(&q, i).unwrap();
                assert!(
                    (pose.to_homogeneous() - expected.to_homogeneous()).amax() < 1e-14,
                    "{base} {}",
                    link.name
                );
            }
        }
    }
}

#[test]
fn bodies_follow_the_joint_before_them_on_the_way_up() {
    let chain = read(ARM, "flange", "mast").unwrap();
    let masses: Vec<f64> = chain.inertias().unwrap().iter().map(|body| body.mass).collect();
    // After roll the forearm moves, after elbow the upper arm, after raise the shoulder, after turn the mast with its camera.
    assert_eq!(masses, [1.8, 3.0, 0.0, 6.9]);
    // After lift the base with all that is fixed to it, above it as well.
    let weighted = ARM.replacen(
        "<link name=\"world\"/>",
        "<link name=\"world\"><inertial><mass value=\"100\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" \
         izz=\"1\"/></inertial></link>",
        1,
    );
    let chain = read(&weighted, "flange", "base_link").unwrap();
    let base = chain.inertias().unwrap()[4];
    assert_eq!(base.mass, 112.0);
    // Seen from the mast's frame at lift = 0: the joint is 0.1 above the base, whose centre is 0.05 above it, and world is
    // (-0.1, 0.2, -0.3) turned by -0.5 about z.
    let (sin, cos) = 0.5f64.sin_cos();
    let world = Vector3::new(-0.1 * cos + 0.2 * sin, 0.2 * cos + 0.1 * sin, -0.4);
    let center = (world * 100.0 + Vector3::new(0.0, 0.0, -0.05) * 12.0) / 112.0;
    assert!((base.center_of_mass - center).norm() < 1e-15, "{} {center}", base.center_of_mass);
}

#[test]
fn entities_and_external_files_do_nothing() {
    let mut laughs = String::from("<?xml version='1.0'?><!DOCTYPE robot [<!ENTITY l0 'ha'>");
    for i in 1..40 {
        laughs += &format!("<!ENTITY l{i} '&l{};&l{};&l{};&l{};'>", i - 1, i - 1, i - 1, i - 1);
    }
    laughs += "]><robot name='&l39;'><link name='a'/></robot>";
    let secret = "<!DOCTYPE robot [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><robot name='&x;'><link name='&x;'/></robot>";
    let remote =
        "<!DOCTYPE robot SYSTEM 'http://localhost:1/robot.dtd'><robot name='r'><link name='a'/></robot>";
    let clock = Instant::now();
    for xml in [laughs.as_str(), secret, remote] {
        let text = message(xml);
        assert!(text.contains("document type definitions"), "{text}");
    }
    // an entity that nobody declared
    assert!(message("<robot name='r'><link name='&x;'/></robot>").contains("XML"));
    assert!(clock.elapsed() < Duration::from_secs(5), "an entity was expanded");
}

#[test]
fn hostile_shapes_are_bounded() {
    let deep = |n: usize| {
        format!(
            "<robot name='r'><link name='a'>{}{}</link></robot>",
            "<visual>".repeat(n),
            "</visual>".repeat(n)
        )
    };
    // half a million levels would overflow the stack of anything that recurses
    let error = Chain::from_urdf_string(&deep(300_000), None, None, MissingLimits::Refuse).unwrap_err();
    assert!(error.to_string().contains("no link is below base 'a'"), "{error}");
    assert!(message(&format!("<robot>{}", "<a>".repeat(1_000_000))).contains("XML"));
    assert!(message(&format!("<robot {}/>", "a='1' ".repeat(300))).contains("attributes"));
    let spaces: String = (0..300).map(|i| format!("<a xmlns:n{i}='u{i}'>")).collect();
    assert!(message(&format!("<robot>{spaces}")).contains("namespace"));
    assert!(message(&".".repeat((16 << 20) + 1)).contains("bytes"));
    assert!(message(&format!("<robot>{}</robot>", "<a/>".repeat(1_500_000))).contains("XML"));
    // a chain of 2 000 joints is unusual but sound
    let long: String = (0..2000)
        .map(|i| {
            format!(
                "<link name='l{}'/><joint name='j{i}' type='continuous'><parent link='l{i}'/><child link='l{}'/></joint>",
                i + 1,
                i + 1
            )
        })
        .collect();
    let xml = format!("<robot name='snake'><link name='l0'/>{long}</robot>");
    let snake = Chain::from_urdf_string(&xml, None, None, MissingLimits::Refuse).unwrap();
    assert_eq!(snake.dof(), 2000);
}

/// Seeded mutations of bytes, of tokens, and of attribute values (these stay well-formed and go deeper). Whatever comes in, a chain or an error comes out.
#[test]
fn mutated_files_never_panic() {
    let rounds = if std::env::var_os("REDUNDANCY_TEST_FULL").is_some() { 200_000 } else { 9_000 };
    let values: Vec<&str> = ARM.split('"').collect();
    let tokens: Vec<&str> = ARM.split_inclusive([' ', '<', '>', '"', '=']).collect();
    let words = [
        "nan",
        "-inf",
        "1e308",
        "1e-320",
        "\"",
        "'",
        "<",
        ">",
        "/>",
        "<joint",
        "</link>",
        "<!DOCTYPE x [",
        "]>",
        "&#0;",
        "&amp;",
        "\u{0}",
        "\u{feff}",
        "fixed",
        "planar",
        "<mimic joint=\"lift\"/>",
        "<![CDATA[",
        "--",
        "",
        "0 0 0",
        "world",
        "flange",
        "quat_xyzw=\"0 0 0 0\"",
        "version=\"1.2\"",
        "é",
    ];
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut chains, mut errors) = (0, 0);
    for round in 0..rounds {
        let xml = if round % 3 == 0 {
            let mut values = values.clone();
            for _ in 0..rng.random_range(1..4) {
                let mut any = || 2 * rng.random_range(0..values.len() / 2) + 1;
                let (at, other) = (any(), any());
                values[at] = match rng.random_range(0..3) {
                    0 => ["nan", "", "0 0 0", "-1", "1e308", "planar", "é", "0.5 0.1 -2"]
                        [rng.random_range(0..8)],
                    _ => values[other],
                };
            }
            values.join("\"")
        } else if round % 3 == 1 {
            let mut bytes = ARM.as_bytes().to_vec();
            for _ in 0..rng.random_range(1..8) {
                let at = rng.random_range(0..bytes.len());
                match rng.random_range(0..4) {
                    0 => bytes[at] = rng.random(),
                    1 => bytes[at] ^= 1 << rng.random_range(0..8),
                    2 => drop(bytes.drain(at..(at + rng.random_range(1..60)).min(bytes.len()))),
                    _ => {
                        let from = rng.random_range(0..bytes.len());
                        let piece = bytes[from..(from + 80).min(bytes.len())].to_vec();
                        bytes.splice(at..at, piece);
                    }
                }
            }
            String::from_utf8_lossy(&bytes).into_owned()
        } else {
            let mut tokens = tokens.clone();
            for _ in 0..rng.random_range(1..5) {
                let at = rng.random_range(0..tokens.len());
                match rng.random_range(0..4) {
                    0 => tokens[at] = words[rng.random_range(0..words.len())],
                    1 => drop(tokens.remove(at)),
                    2 => tokens.insert(at, words[rng.random_range(0..words.len())]),
                    _ => {
                        let other = rng.random_range(0..tokens.len());
                        tokens.swap(at, other);
                    }
                }
            }
            tokens.concat()
        };
        let (base, tip) =
            if round % 4 == 0 { (None, Some("forearm")) } else { (Some("world"), Some("flange")) };
        let missing = if round % 5 == 0 { MissingLimits::Unbounded } else { MissingLimits::Refuse };
        match Chain::from_urdf_string(&xml, base, tip, missing) {
            Ok(chain) => {
                chains += 1;
                let q = vec![0.3; chain.dof()];
                let pose = chain.forward(&q).unwrap();
                assert!(pose.translation.vector.iter().all(|v| !v.is_nan()), "{xml}");
            }
            Err(error) => {
                errors += 1;
                assert!(!error.to_string().is_empty());
            }
        }
    }
    // the mutations must reach both sides to mean anything
    assert!(chains > rounds / 20 && errors > rounds / 20, "{chains} chains, {errors} errors");
}

#[test]
fn what_stands_before_the_declaration_does_no_harm() {
    assert_eq!(read(&format!("\u{feff}\n \n{ARM}"), "world", "flange").unwrap(), arm());
}

#[test]
fn broken_parts_beside_the_way_do_no_harm() {
    // a broken visual, a broken joint to a finger, an unread number fixed to the standing base
    let broken = ARM
        .replace("<cylinder radius=\"0.2\" length=\"0.1\"/>", "<cylinder radius=\"wide\"/>")
        .replace("<axis xyz=\"0 -1 0\"/>", "<axis xyz=\"left\"/>")
        .replace(
            "</robot>",
            "<link name='lamp'/><joint name='lamp' type='fixed'><parent link='base_link'/>\
            <child link='lamp'/><origin xyz='$(arg lamp)'/></joint></robot>",
        );
    assert_eq!(read(&broken, "world", "flange").unwrap(), arm());
    // what is fixed to a moving body counts for its inertia: there it must be right
    let error =
        read(&ARM.replace("rpy=\"0 0.4 0\"", "rpy=\"0 0.4\""), "world", "flange").unwrap_err().to_string();
    assert!(error.contains("'camera_mount'") && error.contains("3 numbers"), "{error}");
}

#[test]
fn files() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/arm.urdf");
    let chain = Chain::from_urdf(path, Some("world"), Some("flange"), MissingLimits::Refuse).unwrap();
    assert_eq!(chain, arm());
    let missing = Chain::from_urdf("no/such.urdf", None, None, MissingLimits::Refuse).unwrap_err();
    assert!(matches!(&missing, Error::File { file, .. } if file == "no/such.urdf"));
    let text = Chain::from_urdf(path, None, None, MissingLimits::Refuse).unwrap_err().to_string();
    assert!(text.contains("arm.urdf") && text.contains("camera"), "{text}");
}
