//! Files that nobody should write: meshes, SRDF and scenes with bytes changed at random. An error or a valid body comes out,
//! never a panic, and nothing takes long.

use std::time::{Duration, Instant};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use redundancy_core::Pose;
use redundancy_core::chain::{Chain, MissingLimits};
use redundancy_core::nalgebra::Vector3;
use redundancy_core::scene::{
    LinkGeometry, Mesh, MeshSolid, Scene, Shape, Srdf, Surroundings, TriangleMesh, UrdfOptions,
    segment_distance,
};

use super::bodies::{DAE, box_mesh, obj, stl};
use super::support::{amount, rng};

/// Words that hurt.
const WORDS: [&str; 24] = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1e308",
    "1e-320",
    "0",
    "-1",
    "4294967295",
    "18446744073709551616",
    "",
    " ",
    "\"",
    "<",
    ">",
    "</",
    "[",
    "{",
    "]}",
    ",",
    "#",
    "/",
    "\0",
    "\u{feff}",
];

/// A few changes of bytes, words or stretches.
fn damaged(rng: &mut ChaCha8Rng, file: &[u8]) -> Vec<u8> {
    let mut out = file.to_vec();
    for _ in 0..rng.random_range(1..5) {
        let at = rng.random_range(0..=out.len());
        let end = (at + rng.random_range(0..40)).min(out.len());
        match rng.random_range(0..7) {
            0 if at < out.len() => out[at] ^= 1 << rng.random_range(0..8),
            1 if at < out.len() => out[at] = rng.random(),
            2 => drop(out.drain(at..end)),
            3 => {
                let piece = out[at..end].to_vec();
                out.splice(at..at, piece.repeat(rng.random_range(1..4)));
            }
            4 => out.truncate(at),
            5 => {
                // A number becomes another word.
                let word = WORDS[rng.random_range(0..WORDS.len())];
                let start = out[..at].iter().rposition(|b| !is_number(*b)).map_or(0, |i| i + 1);
                let stop = out[at..].iter().position(|b| !is_number(*b)).map_or(out.len(), |i| at + i);
                out.splice(start..stop, word.bytes());
            }
            _ => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                out.splice(at..at, word.bytes());
            }
        }
    }
    out
}

fn is_number(byte: u8) -> bool {
    byte.is_ascii_digit() || b"+-.eE".contains(&byte)
}

/// Whatever was read must work.
fn try_out(mesh: &TriangleMesh) {
    let origin = Vector3::zeros();
    for solid in [MeshSolid::Hull, MeshSolid::Exact] {
        if let Ok(mesh) = Mesh::new(mesh, solid, Pose::identity()) {
            let near = segment_distance(&origin, &Vector3::new(0.1, 0.2, 0.3), &Shape::from(mesh));
            assert!(near.distance.is_finite() && near.normal.iter().all(|x| x.is_finite()), "{near:?}");
        }
    }
}

#[test]
fn hostile_files() {
    let mut rng = rng(90);
    let mesh = box_mesh([0.1, 0.2, 0.3]);
    let text_of = |mesh: &TriangleMesh| {
        let mut text = String::from("solid box\n");
        for face in mesh.faces() {
            text.push_str("facet normal 0 0 1\nouter loop\n");
            for i in face {
                let v = mesh.vertices()[*i as usize];
                text.push_str(&format!("vertex {:e} {:e} {:e}\n", v[0], v[1], v[2]));
            }
            text.push_str("endloop\nendfacet\n");
        }
        text + "endsolid\n"
    };
    let scene = r#"{"obstacles": [
        {"type": "mesh", "vertices": [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], "faces": [[0,2,1],[0,1,3],[0,3,2],[1,2,3]], "solid": "exact", "name": "m"},
        {"type": "cylinder", "center": [0, 0, 1], "radius": 0.1, "half_length": 0.2, "quaternion_wxyz": [1, 0, 0, 0], "velocity": [0, 0, 1]},
        {"type": "half_space", "point": [0, 0, -1], "normal": [0, 0, 1]},
        {"type": "capsule", "start": [0, 0, 0], "end": [0, 0, 1], "radius": 0.1, "attached_to": "hand"}], "allowed": [["hand", "m"]]}"#;
    let srdf = r#"<robot name="r"><group name="g"><joint name="a"/></group><disable_collisions link1="base" link2="arm" reason="Adjacent"/>
        <disable_default_collisions link="hand"/><enable_collisions link1="hand" link2="base"/></robot>"#;
    let urdf = r#"<robot name="r"><link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
        <link name="arm"><collision><origin xyz="0 0 0.3" rpy="0 0.1 0"/><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
        <link name="hand"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
        <joint name="a" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
        <joint name="b" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0 0 0.6"/><axis xyz="0 1 0"/>
          <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"#;
    let chain = Chain::from_urdf_string(urdf, Some("base"), Some("hand"), MissingLimits::Refuse).unwrap();
    let links = LinkGeometry::from_urdf_string(&chain, urdf, None, &UrdfOptions::default()).unwrap();
    let meshes: [(&str, Vec<u8>); 4] = [
        ("stl", stl(&mesh)),
        ("stl", text_of(&mesh).into_bytes()),
        ("obj", obj(&mesh).into_bytes()),
        ("dae", DAE.as_bytes().to_vec()),
    ];
    let (mut read, mut refused, mut slowest) = (0, 0, Duration::ZERO);
    for round in 0..amount(1_400, 10_000) {
        let begin = Instant::now();
        let done = match round % 7 {
            kind @ 0..4 => {
                let (format, bytes) = &meshes[kind];
                TriangleMesh::from_bytes(format, &damaged(&mut rng, bytes)).map(|mesh| try_out(&mesh)).is_ok()
            }
            4 => {
                let text = damaged(&mut rng, scene.as_bytes());
                Scene::from_json(&String::from_utf8_lossy(&text)).is_ok_and(|scene| {
                    let around = Surroundings::new(&chain, &links, Some(&scene), true);
                    around.is_ok_and(|around| {
                        let rows = Scene::clearance_batch(&chain, &[0.1, 0.2], &around).unwrap();
                        rows[0].iter().flatten().all(|pair| !pair.distance.is_nan())
                    })
                })
            }
            5 => {
                let text = damaged(&mut rng, srdf.as_bytes());
                Srdf::from_xml(&String::from_utf8_lossy(&text))
                    .is_ok_and(|srdf| links.with_srdf(&srdf).is_ok())
            }
            _ => {
                let text = String::from_utf8_lossy(&damaged(&mut rng, urdf.as_bytes())).into_owned();
                LinkGeometry::from_urdf_string(&chain, &text, None, &UrdfOptions::default()).is_ok()
            }
        };
        slowest = slowest.max(begin.elapsed());
        *(if done { &mut read } else { &mut refused }) += 1;
    }
    assert!(read > 50 && refused > 50, "{read} {refused}");
    assert!(slowest < Duration::from_secs(20), "{slowest:?}");
}

/// Shapes at the edge of what there is: flat, thin, tiny, huge, repeated.
#[test]
fn degenerate_hulls() {
    let mut rng = rng(91);
    for round in 0..amount(300, 3_000) {
        let size = 10f64.powi(rng.random_range(-9..8));
        let flat: [f64; 3] = std::array::from_fn(|_| {
            if rng.random::<f64>() < 0.4 { 0.0 } else { size * 10f64.powi(rng.random_range(-12..1)) }
        });
        let count = rng.random_range(1..60);
        let grid = round % 3 == 0;
        let mut points: Vec<[f64; 3]> = (0..count)
            .map(|_| {
                std::array::from_fn(|k| {
                    let x: f64 = rng.random_range(-1.0..1.0);
                    flat[k] * if grid { (x * 2.0).round() } else { x } + size
                })
            })
            .collect();
        points.push(points[0]);
        let n = points.len() as u32;
        let faces = (0..n).map(|i| [i, (i + 1) % n, (i + 2) % n]).collect();
        let Ok(mesh) = TriangleMesh::new(points.clone(), faces) else { continue };
        let hull = Shape::from(Mesh::new(&mesh, MeshSolid::Hull, Pose::identity()).unwrap());
        let far = Vector3::new(3.0 * size, -2.0 * size, 5.0 * size);
        let near = segment_distance(&far, &far, &hull);
        // Against the vertices: the hull is nearer than all of them, and no further than its extent.
        let least = points.iter().map(|p| (Vector3::from(*p) - far).norm()).fold(f64::INFINITY, f64::min);
        // A search for nearest points ends at an absolute difference: relative to a nanometre it is visible.
        assert!(near.distance <= least * (1.0 + 1e-9) + 1e-10, "{near:?} {least}");
        assert!(
            near.distance >= least - 4.0 * flat.iter().map(|x| x.abs()).sum::<f64>() - 1e-6 * size - 1e-9
        );
        assert!(near.normal.iter().all(|x| x.is_finite()));
    }
}
