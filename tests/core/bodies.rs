//! Bodies: meshes, hulls, distances of convex shapes, pairs of links, sweeps.

use std::path::Path;

use rand::Rng;
use redundancy_core::Pose;
use redundancy_core::chain::{Chain, MissingLimits, catalog};
use redundancy_core::kinematics::Scratch;
use redundancy_core::nalgebra::Vector3;
use redundancy_core::scene::{
    Capsule, Contact, Cuboid, Cylinder, HalfSpace, LinkGeometry, LinkMeshes, Mesh, MeshSolid, Obstacle,
    Proximity, ProximityMemory, Scene, Shape, Sphere, Surroundings, SweepMemory, Thing, TriangleMesh,
    UrdfOptions, Visitor, segment_distance, sweep,
};

use super::allocations;
use super::support::{amount, random_pose, rng};

fn vector(rng: &mut impl Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

/// The triangles of a box around the origin, corners counter-clockwise from outside.
pub fn box_mesh(half: [f64; 3]) -> TriangleMesh {
    let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 0 { -half[k] } else { half[k] });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    TriangleMesh::new((0..8).map(corner).collect(), faces).unwrap()
}

/// A cup: a box without its lid, with walls of some thickness. Not convex, closed.
fn cup() -> TriangleMesh {
    let ring = |x: f64, z: f64| [[-x, -x, z], [x, -x, z], [x, x, z], [-x, x, z]];
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    for (x, z) in [(0.2, 0.0), (0.2, 0.3), (0.15, 0.3), (0.15, 0.05)] {
        vertices.extend(ring(x, z));
    }
    let mut faces: Vec<[u32; 3]> = vec![[0, 2, 1], [0, 3, 2], [12, 13, 14], [12, 14, 15]];
    for level in 0..3u32 {
        for i in 0..4u32 {
            let (a, b) = (4 * level + i, 4 * level + (i + 1) % 4);
            faces.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
    }
    TriangleMesh::new(vertices, faces).unwrap()
}

#[test]
fn meshes_know_whether_they_are_closed() {
    let cup = cup();
    assert!(cup.is_closed());
    assert!((cup.volume() - (0.4 * 0.4 * 0.3 - 0.3 * 0.3 * 0.25)).abs() < 1e-12);
    let open = TriangleMesh::new(cup.vertices().to_vec(), cup.faces()[1..].to_vec()).unwrap();
    assert!(!open.is_closed());
    let solid = box_mesh([0.1, 0.2, 0.3]);
    assert!((solid.volume() - 8.0 * 0.006).abs() < 1e-12);
    let mirrored = solid.mapped(|v| -v, true).unwrap();
    assert!((mirrored.volume() - solid.volume()).abs() < 1e-12);
    assert_eq!(Mesh::new(&solid, MeshSolid::Exact, Pose::identity()).unwrap().pieces(), 1);
    assert_eq!(Mesh::new(&cup, MeshSolid::Exact, Pose::identity()).unwrap().pieces(), 0);
    assert!(TriangleMesh::new(vec![[0.0; 3], [f64::NAN, 0.0, 0.0], [1.0; 3]], vec![[0, 1, 2]]).is_err());
    assert!(TriangleMesh::new(vec![[0.0; 3]], vec![]).is_err());
}

/// Boxes as boxes and as meshes, cylinders against fine prisms, half-spaces against large boxes.
#[test]
fn shapes_agree_with_each_other() {
    let mut rng = rng(70);
    for _ in 0..amount(2_000, 50_000) {
        let (a, b) = (vector(&mut rng, 0.6), vector(&mut rng, 0.6));
        let half: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.01..0.4));
        let pose = random_pose(&mut rng, 0.3);
        let cuboid: Shape = Cuboid { pose, half_extents: half.into() }.into();
        let mesh: Shape = Mesh::new(&box_mesh(half), MeshSolid::Exact, pose).unwrap().into();
        let (one, two) = (segment_distance(&a, &b, &cuboid), segment_distance(&a, &b, &mesh));
        if one.distance > 0.0 {
            assert!((one.distance - two.distance).abs() < 1e-9, "{} {}", one.distance, two.distance);
            assert!((one.normal - two.normal).norm() < 1e-4);
        } else {
            // The whole segment has to leave, not only its deepest point.
            assert!(two.distance <= one.distance + 1e-9, "{} {}", one.distance, two.distance);
        }
        let (normal, point) = (vector(&mut rng, 1.0), vector(&mut rng, 0.3));
        if normal.norm() < 0.1 {
            continue;
        }
        let near = segment_distance(&a, &b, &HalfSpace { point, normal }.into());
        let height = |p: &Vector3<f64>| (p - point).dot(&normal.normalize());
        assert!((near.distance - height(&a).min(height(&b))).abs() < 1e-12);
    }
    for _ in 0..amount(300, 5_000) {
        let (radius, half_length) = (rng.random_range(0.02..0.3), rng.random_range(0.02..0.4));
        let pose = random_pose(&mut rng, 0.2);
        let cylinder: Shape = Cylinder { pose, radius, half_length }.into();
        let p = vector(&mut rng, 0.8);
        // A point against a cylinder has a closed form.
        let x = pose.inverse_transform_point(&p.into());
        let (side, end) = (x.x.hypot(x.y) - radius, x.z.abs() - half_length);
        let expected = if side.max(end) <= 0.0 { side.max(end) } else { side.max(0.0).hypot(end.max(0.0)) };
        let near = segment_distance(&p, &p, &cylinder);
        assert!((near.distance - expected).abs() < 1e-6, "{} {expected}", near.distance);
    }
}

#[test]
fn a_cup_is_hollow() {
    let cup: Shape = Mesh::new(&cup(), MeshSolid::Exact, Pose::identity()).unwrap().into();
    let at = |x: f64, y: f64, z: f64| {
        segment_distance(&Vector3::new(x, y, z), &Vector3::new(x, y, z), &cup).distance
    };
    assert!((at(0.0, 0.0, 0.2) - 0.15).abs() < 1e-9); // inside of the cup, in the air
    assert!((at(0.0, 0.0, 0.07) - 0.02).abs() < 1e-9);
    assert!((at(0.175, 0.0, 0.2) + 0.025).abs() < 1e-9); // in the wall
    assert!((at(0.0, 0.0, 0.02) + 0.02).abs() < 1e-9); // in the floor
    assert!((at(0.0, 0.0, 0.5) - 0.25f64.min((0.15f64).hypot(0.2))).abs() < 1e-9);
    let hull: Shape = Mesh::new(&self::cup(), MeshSolid::Hull, Pose::identity()).unwrap().into();
    let p = Vector3::new(0.0, 0.0, 0.2);
    assert!(segment_distance(&p, &p, &hull).distance < -0.09);
}

/// Signed distance of hulls by brute force: the best of many directions, then refined.
#[test]
fn hulls_against_directions() {
    let mut rng = rng(71);
    let arm = slider();
    let mut memory = ProximityMemory::new();
    for _ in 0..amount(200, 3_000) {
        let cloud =
            |rng: &mut _, size: f64| -> Vec<[f64; 3]> { (0..30).map(|_| vector(rng, size).into()).collect() };
        let (first, second) = (cloud(&mut rng, 0.2), cloud(&mut rng, 0.3));
        let pose = random_pose(&mut rng, 0.4);
        let hull = |points: &[[f64; 3]]| {
            let faces = (0..points.len() as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
            TriangleMesh::new(points.to_vec(), faces).unwrap()
        };
        let tool = Shape::from(Mesh::new(&hull(&first), MeshSolid::Hull, Pose::identity()).unwrap());
        let links = LinkGeometry::default().with_shape(&arm, "slide", &tool, &Pose::identity()).unwrap();
        let scene = Scene::new(&[Mesh::new(&hull(&second), MeshSolid::Hull, pose).unwrap().into()]).unwrap();
        let around = Surroundings::new(&arm, &links, Some(&scene), false).unwrap();
        let mut scratch = Scratch::new(&arm);
        let kinematics = arm.kinematics(&[0.0], &mut scratch).unwrap();
        let near = around.nearest(&kinematics, 0.0, f64::INFINITY, &mut memory).unwrap().gap;
        let gap = |n: &Vector3<f64>| {
            let low = first.iter().map(|p| Vector3::from(*p).dot(n)).fold(f64::INFINITY, f64::min);
            let place = |p: &[f64; 3]| (pose * redundancy_core::nalgebra::Point3::from(*p)).coords.dot(n);
            low - second.iter().map(place).fold(f64::NEG_INFINITY, f64::max)
        };
        assert!((gap(&near.normal) - near.distance).abs() < 1e-7, "the normal proves the distance");
        // No direction does better.
        let mut best = f64::NEG_INFINITY;
        for _ in 0..300 {
            let mut n = vector(&mut rng, 1.0).normalize();
            let mut step = 0.3;
            while step > 1e-4 {
                let next = (n + vector(&mut rng, step)).normalize();
                if gap(&next) > gap(&n) { n = next } else { step *= 0.8 }
            }
            best = best.max(gap(&n));
        }
        assert!(best <= near.distance + 1e-9, "{best} {}", near.distance);
        assert!(best >= near.distance - 2e-2);
        let between = near.on_first - near.on_second;
        assert!((between - near.normal * near.distance).norm() < 1e-6);
    }
}

fn slider() -> Chain {
    let xml = r#"<robot name="slider"><link name="base"/><link name="slide"/>
        <joint name="x" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"#;
    Chain::from_urdf_string(xml, None, None, MissingLimits::Refuse).unwrap()
}

/// An arm with boxes, cylinders and hulls on its links.
fn bodied(arm: &Chain) -> LinkGeometry {
    let mut links = LinkGeometry::default();
    for (i, link) in arm.links().iter().enumerate().filter(|(_, link)| link.joints_before > 0) {
        let at = Pose::translation(0.01, 0.02 * (i as f64).sin(), 0.05);
        let shape: Shape = match i % 3 {
            0 => Cylinder { pose: Pose::identity(), radius: 0.05, half_length: 0.09 }.into(),
            1 => Cuboid { pose: Pose::identity(), half_extents: Vector3::new(0.04, 0.05, 0.1) }.into(),
            _ => Mesh::new(&box_mesh([0.05, 0.03, 0.08]), MeshSolid::Hull, Pose::identity()).unwrap().into(),
        };
        links = links.with_shape(arm, &link.name, &shape, &at).unwrap();
    }
    links.find_pairs(arm, &mut |_| true).unwrap()
}

fn mixed_scene(rng: &mut impl Rng) -> Scene {
    let shapes: Vec<Shape> = vec![
        Sphere { center: vector(rng, 0.8), radius: 0.1 }.into(),
        Cylinder { pose: random_pose(rng, 0.8), radius: 0.1, half_length: 0.2 }.into(),
        HalfSpace { point: Vector3::new(0.0, 0.0, -0.4), normal: Vector3::z() }.into(),
        Mesh::new(&cup(), MeshSolid::Exact, random_pose(rng, 0.7)).unwrap().into(),
        Capsule { start: vector(rng, 0.8), end: vector(rng, 0.8), radius: 0.05 }.into(),
    ];
    let mut obstacles: Vec<Obstacle> = shapes.into_iter().map(|s| Obstacle::fixed(s).unwrap()).collect();
    obstacles[0].velocity = Vector3::new(0.1, -0.2, 0.05);
    Scene::of_obstacles(obstacles).unwrap()
}

/// All pairs of a scan.
#[derive(Default)]
struct All {
    upto: f64,
    found: Vec<(Thing, Thing, f64, Vec<f64>, f64)>,
    kinematics: Option<*const ()>,
}

fn pairs_of(
    around: &Surroundings,
    arm: &Chain,
    q: &[f64],
    t: f64,
    upto: f64,
    memory: &mut ProximityMemory,
) -> Vec<(Thing, Thing, f64, Vec<f64>, f64)> {
    struct Gather<'a, 'k>(&'a redundancy_core::kinematics::Kinematics<'k>, All);
    impl Visitor for Gather<'_, '_> {
        fn limit(&self, _: Thing, _: Thing) -> f64 {
            self.1.upto
        }
        fn found(&mut self, contact: &Contact<'_>) -> bool {
            let mut gradient = vec![0.0; self.0.origins().len()];
            contact.add_gradient(self.0, 1.0, &mut gradient);
            let row = (contact.first, contact.second, contact.gap.distance, gradient, contact.by_time());
            self.1.found.push(row);
            true
        }
    }
    let mut scratch = Scratch::new(arm);
    let kinematics = arm.kinematics(q, &mut scratch).unwrap();
    let mut gather = Gather(&kinematics, All { upto, ..All::default() });
    around.scan(&kinematics, t, memory, &mut gather);
    assert!(gather.1.kinematics.is_none());
    gather.1.found
}

#[test]
fn gradients_against_differences() {
    let mut rng = rng(72);
    let mut memory = ProximityMemory::new();
    let (mut checked, mut kinks) = (0, 0);
    for name in ["iiwa14", "panda", "dexter"] {
        let arm = catalog::load(name).unwrap();
        let links = bodied(&arm);
        assert!(!links.pairs().is_empty());
        for _ in 0..amount(6, 60) {
            let around = Surroundings::new(&arm, &links, Some(&mixed_scene(&mut rng)), true).unwrap();
            let q: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-1.8..1.8)).collect();
            let here = pairs_of(&around, &arm, &q, 0.3, f64::INFINITY, &mut memory);
            let at = |q: &[f64], t: f64, memory: &mut ProximityMemory| -> Vec<f64> {
                pairs_of(&around, &arm, q, t, f64::INFINITY, memory).iter().map(|row| row.2).collect()
            };
            let h = 1e-6;
            for k in 0..=arm.dof() {
                let shifted = |sign: f64, memory: &mut ProximityMemory| {
                    let mut q = q.clone();
                    match q.get_mut(k) {
                        Some(q) => *q += sign * h,
                        None => return at(&q, 0.3 + sign * h, memory),
                    }
                    at(&q, 0.3, memory)
                };
                let (plus, minus) = (shifted(1.0, &mut memory), shifted(-1.0, &mut memory));
                for (i, row) in here.iter().enumerate() {
                    let difference = (plus[i] - minus[i]) / (2.0 * h);
                    let analytic = row.3.get(k).copied().unwrap_or(row.4);
                    checked += 1;
                    // Where a nearest feature changes differences say nothing.
                    kinks += usize::from((difference - analytic).abs() > 1e-3 * (1.0 + difference.abs()));
                }
            }
        }
    }
    assert!(kinks * 100 < checked, "{kinks} of {checked}");
}

#[test]
fn scans_find_what_is_nearer_than_asked() {
    let mut rng = rng(73);
    let mut memory = ProximityMemory::new();
    let arm = catalog::load("panda").unwrap();
    let links = bodied(&arm);
    for _ in 0..40 {
        let around = Surroundings::new(&arm, &links, Some(&mixed_scene(&mut rng)), true).unwrap();
        let q: Vec<f64> = (0..7).map(|_| rng.random_range(-1.8..1.8)).collect();
        let all = pairs_of(&around, &arm, &q, 0.0, f64::INFINITY, &mut memory);
        for upto in [-0.02, 0.0, 0.05, 0.2] {
            let near = pairs_of(&around, &arm, &q, 0.0, upto, &mut memory);
            let expected: Vec<_> = all.iter().filter(|row| row.2 < upto).collect();
            assert_eq!(near.len(), expected.len(), "{upto}");
            for (a, b) in near.iter().zip(expected) {
                assert!((a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() < 1e-9);
            }
            let mut scratch = Scratch::new(&arm);
            let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
            assert_eq!(around.is_clear(&kinematics, 0.0, upto, &mut memory), near.is_empty());
            let least = around.nearest(&kinematics, 0.0, f64::INFINITY, &mut memory).unwrap();
            let smallest = all.iter().map(|row| row.2).fold(f64::INFINITY, f64::min);
            assert!((least.gap.distance - smallest).abs() < 1e-9);
            // Nothing allocates once the memory has grown.
            let count = allocations::count(|| around.is_clear(&kinematics, 0.0, upto, &mut memory));
            assert_eq!(count, 0);
            let count = allocations::count(|| around.nearest(&kinematics, 0.0, 1.0, &mut memory));
            assert_eq!(count, 0);
        }
    }
}

/// A sweep that says clear is clear at every sample; one that does not is near something.
#[test]
fn sweeps_against_samples() {
    let mut rng = rng(74);
    let (mut clear, mut hit) = (0, 0);
    let mut memory = ProximityMemory::new();
    for name in ["iiwa14", "dexter"] {
        let arm = catalog::load(name).unwrap();
        let links = bodied(&arm);
        let mut sweeps = SweepMemory::new(&arm);
        for _ in 0..amount(60, 600) {
            let around = Surroundings::new(&arm, &links, Some(&mixed_scene(&mut rng)), true).unwrap();
            let from: Vec<f64> = (0..arm.dof()).map(|_| rng.random_range(-1.8..1.8)).collect();
            let to: Vec<f64> = from.iter().map(|q| q + rng.random_range(-0.3..0.3)).collect();
            let by = 0.01;
            let answer = sweep(&around, [&from, &to], [0.0, 0.5], by, &mut sweeps);
            let mut least = f64::INFINITY;
            let mut scratch = Scratch::new(&arm);
            for i in 0..=400 {
                let share = f64::from(i) / 400.0;
                let q: Vec<f64> = from.iter().zip(&to).map(|(a, b)| a + share * (b - a)).collect();
                let kinematics = arm.kinematics(&q, &mut scratch).unwrap();
                let near = around.nearest(&kinematics, 0.5 * share, 1.0, &mut memory);
                least = least.min(near.map_or(1.0, |near| near.gap.distance));
            }
            match answer {
                None => {
                    clear += 1;
                    assert!(least >= by - 1e-9, "{least}");
                }
                Some(found) => {
                    hit += 1;
                    assert!(least < by + 2e-3, "{least} {found:?}");
                }
            }
        }
    }
    assert!(clear > 20 && hit > 20, "{clear} {hit}");
}

#[test]
fn carried_obstacles_and_allowed_pairs() {
    let arm = catalog::load("iiwa14").unwrap();
    let links = LinkGeometry::joint_to_joint(&arm, 0.05).unwrap();
    let tip = arm.links().last().unwrap().name.clone();
    let q = [0.3, 0.6, -0.2, 1.2, 0.1, -0.5, 0.4];
    let rod = Capsule { start: Vector3::zeros(), end: Vector3::new(0.0, 0.0, 0.3), radius: 0.02 };
    let carried = Obstacle::fixed(rod.into()).unwrap().named("rod").unwrap().attached_to(&tip).unwrap();
    let end = arm.forward(&q).unwrap() * redundancy_core::nalgebra::Point3::new(0.0, 0.0, 0.3);
    let ball =
        Obstacle::fixed(Sphere { center: end.coords, radius: 0.01 }.into()).unwrap().named("ball").unwrap();
    let scene = Scene::of_obstacles(vec![carried, ball]).unwrap();
    let mut memory = ProximityMemory::new();
    let mut scratch = Scratch::new(&arm);
    let nearest = |scene: &Scene, memory: &mut ProximityMemory, scratch: &mut Scratch| {
        let around = Surroundings::new(&arm, &links, Some(scene), false).unwrap();
        around.nearest(&arm.kinematics(&q, scratch).unwrap(), 0.0, f64::INFINITY, memory).unwrap()
    };
    let near = nearest(&scene, &mut memory, &mut scratch);
    assert_eq!((near.first, near.second), (Thing::Obstacle(0), Thing::Obstacle(1)));
    assert!((near.gap.distance + 0.03).abs() < 1e-9);
    let pair = |a: &str, b: &str| [a.to_owned(), b.to_owned()];
    // The rod begins so near to joint 7 that it overlaps the link before it.
    let allowed = scene.with_allowed(vec![pair("rod", "ball"), pair("rod", "link_6")]).unwrap();
    let near = nearest(&allowed, &mut memory, &mut scratch);
    let all = Surroundings::new(&arm, &links, Some(&scene), false).unwrap();
    let rod = Thing::Obstacle(0);
    let sixth = links.names().iter().position(|name| name == "link_6").map(Thing::Link);
    let may = |a: Thing, b: Thing| a == rod && (b == Thing::Obstacle(1) || Some(b) == sixth);
    let rows = pairs_of(&all, &arm, &q, 0.0, f64::INFINITY, &mut memory);
    let others = rows.iter().filter(|row| !may(row.0, row.1) && !may(row.1, row.0));
    let least = others.map(|row| row.2).fold(f64::INFINITY, f64::min);
    assert!((near.gap.distance - least).abs() < 1e-12 && least > -0.02, "{near:?} {least}");
    assert!(!may(near.first, near.second) && !may(near.second, near.first), "{near:?}");
    assert!(scene.with_allowed(vec![pair("rod", "bal")]).is_ok()); // a link may have that name
    let wrong = scene.with_allowed(vec![pair("rod", "bal")]).unwrap();
    let error = Surroundings::new(&arm, &links, Some(&wrong), false).unwrap_err().to_string();
    assert!(error.contains("'bal'"), "{error}");
    assert!(scene.with_allowed(vec![pair("a", "b")]).is_err());
    // What a link carries moves with it.
    let (mut checked, h) = (0, 1e-6);
    let around = Surroundings::new(&arm, &links, Some(&scene), false).unwrap();
    let here = pairs_of(&around, &arm, &q, 0.0, f64::INFINITY, &mut memory);
    for k in 0..7 {
        let at = |sign: f64, memory: &mut ProximityMemory| {
            let mut q = q;
            q[k] += sign * h;
            pairs_of(&around, &arm, &q, 0.0, f64::INFINITY, memory)
        };
        let (plus, minus) = (at(1.0, &mut memory), at(-1.0, &mut memory));
        for i in 0..here.len() {
            let difference = (plus[i].2 - minus[i].2) / (2.0 * h);
            // At the centre of the ball the distance has a kink.
            if here[i].0 != Thing::Obstacle(0) || here[i].1 != Thing::Obstacle(1) {
                assert!((difference - here[i].3[k]).abs() < 1e-6);
                checked += 1;
            }
        }
    }
    assert!(checked > 50);
}

fn urdf(mesh: &str) -> String {
    format!(
        r#"<robot name="r"><link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
        <link name="arm"><collision><origin xyz="0 0 0.3"/><geometry><mesh filename="{mesh}" scale="2 1 -1"/></geometry></collision></link>
        <link name="hand"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
        <link name="finger"><collision><geometry><capsule radius="0.01" length="0.05"/></geometry></collision></link>
        <link name="thumb"><collision><geometry><cylinder radius="0.01" length="0.05"/></geometry></collision></link>
        <joint name="a" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
        <joint name="b" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz="0 0 0.6"/><axis xyz="0 1 0"/></joint>
        <joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="1 0 0"/>
          <limit lower="0.02" upper="0.04" velocity="1" effort="1"/></joint>
        <joint name="grip2" type="prismatic"><parent link="hand"/><child link="thumb"/><axis xyz="-1 0 0"/>
          <mimic joint="grip" multiplier="2" offset="0.01"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint></robot>"#
    )
}

#[test]
fn urdf_with_meshes() {
    let folder = std::env::temp_dir().join(format!("redundancy-bodies-{}", std::process::id()));
    let package = folder.join("robot_package").join("meshes");
    std::fs::create_dir_all(&package).unwrap();
    let half = [0.05, 0.06, 0.1];
    std::fs::write(package.join("link.obj"), obj(&box_mesh(half))).unwrap();
    let xml = urdf("package://robot_package/meshes/link.obj");
    let chain = Chain::from_urdf_string(&xml, Some("base"), Some("hand"), MissingLimits::Refuse).unwrap();
    let options = UrdfOptions { package_dirs: vec![folder.clone()], ..UrdfOptions::default() };
    let read = |options: &UrdfOptions, home: Option<&Path>| {
        LinkGeometry::from_urdf_string(&chain, &xml, home, options)
    };
    let links = read(&options, None).unwrap();
    assert_eq!(links.names(), ["base", "arm", "hand", "finger", "thumb"]);
    assert_eq!(
        links.pairs(),
        [[0, 2], [0, 3], [0, 4], [1, 3], [1, 4]]
            .iter()
            .copied()
            .filter(|p| links.pairs().contains(p))
            .collect::<Vec<_>>()
    );
    // The folder of the package itself, the folders above the file, and the environment's are searched too.
    let inside = UrdfOptions { package_dirs: vec![folder.join("robot_package")], ..UrdfOptions::default() };
    assert_eq!(read(&inside, None).unwrap(), links);
    assert_eq!(read(&UrdfOptions::default(), Some(&package)).unwrap(), links);
    let error = read(&UrdfOptions::default(), None).unwrap_err().to_string();
    assert!(error.contains("link 'arm'") && error.contains("package_dirs"), "{error}");
    let error = read(&UrdfOptions { package_dirs: vec!["/nowhere".into()], ..UrdfOptions::default() }, None);
    assert!(error.unwrap_err().to_string().contains("/nowhere/robot_package/meshes/link.obj"));
    let refuse = UrdfOptions { meshes: LinkMeshes::Refuse, ..options.clone() };
    assert!(read(&refuse, None).unwrap_err().to_string().contains("link 'arm'"));
    // Scaled by (2, 1, -1) around (0, 0, .3): 0.1 to either side of x, the fingers at 0.02 and 0.05.
    let scene = |x: f64, y: f64, z: f64| {
        Scene::new(&[Sphere { center: Vector3::new(x, y, z), radius: 0.0 }.into()]).unwrap()
    };
    let distance = |links: &LinkGeometry, scene: &Scene, link: &str| {
        let around = Surroundings::new(&chain, links, Some(scene), false).unwrap();
        let rows = Scene::clearance_batch(&chain, &[0.0, 0.0], &around).unwrap();
        rows[0][links.index(link).unwrap()].unwrap().distance
    };
    assert!((distance(&links, &scene(0.3, 0.0, 0.3), "arm") - 0.2).abs() < 1e-9);
    assert!((distance(&links, &scene(0.0, 0.3, 0.3), "arm") - 0.24).abs() < 1e-9);
    assert!((distance(&links, &scene(0.0, 0.0, 0.8), "arm") - 0.4).abs() < 1e-9);
    assert!((distance(&links, &scene(0.2, 0.0, 0.6), "finger") - 0.17).abs() < 1e-9);
    assert!((distance(&links, &scene(-0.2, 0.0, 0.6), "thumb") - 0.14).abs() < 1e-9);
    let posture = UrdfOptions { posture: vec![("grip".into(), 0.03)], padding: 0.004, ..options.clone() };
    let wide = read(&posture, None).unwrap();
    assert!((distance(&wide, &scene(0.2, 0.0, 0.6), "finger") - 0.156).abs() < 1e-9);
    assert!((distance(&wide, &scene(-0.2, 0.0, 0.6), "thumb") - 0.116).abs() < 1e-9);
    for (joint, part) in [("a", "moves with the chain"), ("grap", "grip")] {
        let wrong = UrdfOptions { posture: vec![(joint.into(), 0.0)], ..options.clone() };
        assert!(read(&wrong, None).unwrap_err().to_string().contains(part));
    }
    // Kept and read again.
    let again = LinkGeometry::from_json(&chain, &links.to_json()).unwrap();
    assert_eq!((again.names(), again.pairs()), (links.names(), links.pairs()));
    assert!(
        (distance(&again, &scene(0.3, 0.1, 0.5), "arm") - distance(&links, &scene(0.3, 0.1, 0.5), "arm"))
            .abs()
            < 1e-12
    );
    std::fs::remove_dir_all(folder).unwrap();
}

pub fn obj(mesh: &TriangleMesh) -> String {
    let mut out = String::from("# a mesh\no thing\n");
    mesh.vertices().iter().for_each(|v| out.push_str(&format!("v {} {} {}\n", v[0], v[1], v[2])));
    mesh.faces()
        .iter()
        .for_each(|f| out.push_str(&format!("f {}/1 {}//2 {}\n", f[0] + 1, f[1] + 1, f[2] + 1)));
    out
}

pub fn stl(mesh: &TriangleMesh) -> Vec<u8> {
    let mut out = vec![0; 80];
    out.extend((mesh.faces().len() as u32).to_le_bytes());
    for face in mesh.faces() {
        out.extend([0; 12]);
        for corner in face {
            mesh.vertices()[*corner as usize].iter().for_each(|x| out.extend((*x as f32).to_le_bytes()));
        }
        out.extend([0; 2]);
    }
    out
}

#[test]
fn the_same_mesh_in_every_format() {
    let mesh = cup();
    let one = TriangleMesh::from_bytes("obj", obj(&mesh).as_bytes()).unwrap();
    assert_eq!(one.faces().len(), mesh.faces().len());
    assert!((one.volume() - mesh.volume()).abs() < 1e-15);
    let two = TriangleMesh::from_bytes("stl", &stl(&mesh)).unwrap();
    assert!(two.is_closed() && (two.volume() - mesh.volume()).abs() < 1e-8);
    let mut text = String::from("solid cup\n");
    for face in mesh.faces() {
        text.push_str("facet normal 0 0 0\n outer loop\n");
        for corner in face {
            let v = mesh.vertices()[*corner as usize];
            text.push_str(&format!("  vertex {} {} {}\n", v[0], v[1], v[2]));
        }
        text.push_str(" endloop\nendfacet\n");
    }
    let three = TriangleMesh::from_bytes("stl", format!("{text}endsolid cup\n").as_bytes()).unwrap();
    assert!((three.volume() - mesh.volume()).abs() < 1e-15);
    for (format, bytes, part) in [
        ("stl", stl(&mesh)[..300].to_vec(), "take"),
        ("stl", b"solid x\n vertex 1 2\n".to_vec(), "line 2"),
        ("stl", b"solid x\n vertex 1 2 nan\n".to_vec(), "line 2"),
        ("stl", b"short".to_vec(), "5 bytes"),
        ("obj", b"v 0 0 0\nf 1 2 3\n".to_vec(), "line 2"),
        ("obj", b"v 0 0\n".to_vec(), "line 1"),
        ("obj", b"v 0 0 0\n".to_vec(), "no faces"),
        ("obj", b"v 0 0 0\nf -1 -2 -1\n".to_vec(), "line 2"),
        ("dae", b"<COLLADA/>".to_vec(), "no faces"),
        ("dae", b"<!DOCTYPE a><COLLADA/>".to_vec(), "document type"),
        ("ply", b"ply".to_vec(), "stl, obj, dae"),
    ] {
        let error = TriangleMesh::from_bytes(format, &bytes).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

pub const DAE: &str = r##"<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="a" count="12">0 0 0 100 0 0 0 100 0 0 0 100</float_array>
    <technique_common><accessor source="#a" count="4" stride="3"/></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <polylist count="4"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
    <vcount>3 3 3 3</vcount><p>0 0 2 0 1 0 0 0 1 0 3 0 0 0 3 0 2 0 1 0 2 0 3 0</p></polylist>
</mesh></geometry></library_geometries>
<library_nodes><node id="twice"><translate>0 0 300</translate><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s"><node><matrix>1 0 0 200 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
  <node><rotate>0 0 1 90</rotate><scale>2 1 1</scale><instance_geometry url="#g"/></node>
  <instance_node url="#twice"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"##;

#[test]
fn collada_nodes_and_units() {
    let mesh = TriangleMesh::from_bytes("dae", DAE.as_bytes()).unwrap();
    // One tetrahedron of twice the volume, and one as it is.
    assert!((mesh.volume() - 3.0 / 6.0).abs() < 1e-12);
    assert!(mesh.vertices().iter().any(|v| (Vector3::from(*v) - Vector3::new(2.0, 2.0, 0.0)).norm() < 1e-12));
    assert!(mesh.vertices().iter().any(|v| (Vector3::from(*v) - Vector3::new(2.0, 0.0, 4.0)).norm() < 1e-12));
    let refused = |from: &str, to: &str| {
        let text = DAE.replace(from, to);
        assert!(text != DAE);
        TriangleMesh::from_bytes("dae", text.as_bytes()).unwrap_err().to_string()
    };
    assert!(refused("count=\"12\"", "count=\"13\"").contains("announces 13 numbers and has 12"));
    assert!(refused("count=\"4\" stride", "count=\"5\" stride").contains("5 points"));
    assert!(refused("3 3 3 3", "3 3 3 4").contains("vcount"));
    assert!(refused("3 3 3 3", "3 3 3").contains("vcount"));
    assert!(refused("0 0 2 0 1 0", "0 0 9 0 1 0").contains("vertex 9"));
    assert!(refused("meter=\"0.01\"", "meter=\"-1\"").contains("unit"));
    assert!(refused("url=\"#twice\"", "url=\"#never\"").contains("#never"));
    assert!(refused("100 0 0 0 100", "1e999 0 0 0 100").contains("finite"));
    // A node that contains itself, and one that doubles forty times.
    let cycle = refused("<translate>0 0 300</translate>", "<instance_node url=\"#twice\"/>");
    assert!(cycle.contains("nested"), "{cycle}");
    let mut nodes = String::new();
    for i in 0..40 {
        let next = format!("<instance_node url=\"#n{}\"/>", i + 1);
        nodes.push_str(&format!("<node id=\"n{i}\">{next}{next}</node>"));
    }
    nodes.push_str("<node id=\"n40\"><instance_geometry url=\"#g\"/></node></library_nodes>");
    let bomb = DAE.replace("</library_nodes>", &nodes).replace("url=\"#twice\"", "url=\"#n0\"");
    assert!(TriangleMesh::from_bytes("dae", bomb.as_bytes()).unwrap_err().to_string().contains("nested"));
}

#[test]
fn decomposition_contains_the_surface() {
    let mesh = cup();
    let pieces = Mesh::new(&mesh, MeshSolid::Decompose, Pose::identity()).unwrap();
    assert!(pieces.pieces() >= 4, "{}", pieces.pieces());
    let shape: Shape = pieces.into();
    let distance = |p: Vector3<f64>| segment_distance(&p, &p, &shape).distance;
    let mut rng = rng(75);
    for _ in 0..300 {
        let face = mesh.faces()[rng.random_range(0..mesh.faces().len())];
        let corner = face.map(|i| Vector3::from(mesh.vertices()[i as usize]));
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        assert!(distance(corner[0] + (corner[1] - corner[0]) * u + (corner[2] - corner[0]) * v) < 1e-9);
    }
    assert!(distance(Vector3::new(0.0, 0.0, 0.2)) > 0.1); // and the cup is still hollow
}
