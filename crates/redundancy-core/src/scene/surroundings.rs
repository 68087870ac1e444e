//! An arm beside obstacles, its own links or both, put together for distances.

use std::collections::HashSet;
use std::sync::Arc;

use nalgebra::Vector3;

use super::body::Body;
use super::convex::Memory;
use super::distance::to_capsule;
use super::geometry::LinkGeometry;
use super::narrow::{Gap, Placement, from_nearest, gap, rods_apart};
use super::obstacle::Capsule;
use super::proximity::{Contact, Proof, Proximity, ProximityMemory, Thing, Visitor};
use super::scene::Scene;
use super::segment::{has_closed_form, to_solid};
use super::solid::{Rod, Solid};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::Kinematics;

/// What an arm keeps a distance from: see [`Proximity`]. Immutable and cheap to clone.
///
/// ```
/// use redundancy_core::{chain::catalog, kinematics::Scratch, nalgebra::Vector3};
/// use redundancy_core::scene::{LinkGeometry, Proximity, ProximityMemory, Scene, Sphere, Surroundings, Thing};
/// let arm = catalog::load("pa10")?; // stretched upwards through (0, 0, .765)
/// let scene = Scene::new(&[Sphere { center: Vector3::new(0.0, 0.3, 0.765), radius: 0.1 }.into()])?;
/// let links = LinkGeometry::joint_to_joint(&arm, 0.05)?;
/// let around = Surroundings::new(&arm, &links, Some(&scene), false)?;
/// let (mut scratch, mut memory) = (Scratch::new(&arm), ProximityMemory::new());
/// let kinematics = arm.kinematics(&[0.0; 7], &mut scratch)?;
/// assert!(around.is_clear(&kinematics, 0.0, 0.149, &mut memory));
/// let near = around.nearest(&kinematics, 0.0, f64::INFINITY, &mut memory).map(|near| near.gap.distance);
/// assert!(near.is_some_and(|distance| (distance - 0.15).abs() < 1e-12));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Surroundings {
    inner: Arc<Inner>,
}

#[derive(Debug, Clone)]
struct Inner {
    chain: Chain,
    links: LinkGeometry,
    scene: Option<Scene>,
    /// The links' shapes, then those of obstacles that links carry.
    bodies: Vec<Body>,
    things: Vec<Thing>,
    /// Names of links: those with shapes first, then others that carry something.
    names: Vec<String>,
    /// The link that carries an obstacle, by its index in the names.
    carriers: Vec<Option<usize>>,
    /// Shapes of obstacles that stand in the world.
    solids: Vec<WorldSolid>,
    /// Pairs of bodies; more joints move the first.
    pairs: Vec<[u32; 2]>,
    /// For each body the shapes of the world that it must not touch.
    beside: Vec<Vec<u32>>,
    moves: bool,
}

#[derive(Debug, Clone)]
struct WorldSolid {
    solid: Solid,
    obstacle: usize,
    velocity: Vector3<f64>,
}

impl Surroundings {
    /// The links of `chain` beside the obstacles of a scene, and beside each other where `self_collision` asks for it: the pairs
    /// of `links`.
    ///
    /// # Errors
    /// A name in the scene (a pair that is allowed, a link that carries something) that is neither a link nor an obstacle.
    pub fn new(
        chain: &Chain,
        links: &LinkGeometry,
        scene: Option<&Scene>,
        self_collision: bool,
    ) -> Result<Self> {
        let mut inner = Inner {
            chain: chain.clone(),
            links: links.clone(),
            scene: scene.cloned(),
            bodies: links.bodies().to_vec(),
            things: links.bodies().iter().map(|body| Thing::Link(body.owner)).collect(),
            names: links.names().to_vec(),
            carriers: Vec::new(),
            solids: Vec::new(),
            pairs: Vec::new(),
            beside: Vec::new(),
            moves: scene.is_some_and(Scene::moves),
        };
        let allowed = scene.map_or_else(|| Ok(HashSet::new()), |scene| allowed(chain, links, scene))?;
        for [a, b] in links.pairs().iter().filter(|_| self_collision) {
            let (a, b) = (Thing::Link(*a), Thing::Link(*b));
            if !allowed.contains(&(a, b)) {
                inner.pair_all(a, b);
            }
        }
        if let Some(scene) = scene {
            inner.add_obstacles(scene, &allowed)?;
        }
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The links.
    pub fn geometry(&self) -> &LinkGeometry {
        &self.inner.links
    }

    /// The scene.
    pub fn scene(&self) -> Option<&Scene> {
        self.inner.scene.as_ref()
    }

    /// Names of the links: those that have shapes, in the order of the geometry, then others that carry obstacles.
    pub fn link_names(&self) -> &[String] {
        &self.inner.names
    }

    /// The link that carries an obstacle.
    pub(super) fn carrier(&self, obstacle: usize) -> Option<usize> {
        self.inner.carriers.get(obstacle).copied().flatten()
    }

    /// True where there is nothing to keep a distance from.
    pub fn is_empty(&self) -> bool {
        self.inner.pairs.is_empty() && self.inner.beside.iter().all(Vec::is_empty)
    }

    /// What a point of the arm moves at most per joint, of the bodies that are checked, m.
    pub(crate) fn reach(&self) -> Vec<f64> {
        let inner = &*self.inner;
        let mut reach = vec![0.0f64; inner.chain.dof()];
        let paired = inner.pairs.iter().flatten().map(|i| *i as usize);
        let beside = inner.beside.iter().enumerate().filter(|(_, list)| !list.is_empty()).map(|(i, _)| i);
        for body in paired.chain(beside) {
            for (most, own) in reach.iter_mut().zip(&inner.bodies[body].reach) {
                *most = most.max(*own);
            }
        }
        reach
    }

    /// How many joints move a link or an obstacle: none where it stands in the world or has no shape.
    pub(crate) fn joints_before(&self, thing: Thing) -> usize {
        let body = self.inner.of(thing).next();
        body.map_or(0, |body| self.inner.bodies[body].joints_before)
    }

    /// For each number of joints the largest of `of` over the bodies that so many joints move, which must be a convex function
    /// that no metre of way changes by more than a metre. Of what is beyond the last number that of the last.
    pub(crate) fn furthest(
        &self,
        kinematics: &Kinematics<'_>,
        out: &mut [f64],
        of: impl Fn(usize, &Vector3<f64>) -> f64,
    ) {
        let last = out.len().saturating_sub(1);
        for body in &self.inner.bodies {
            let group = body.joints_before.min(last);
            let rod = body.rod(kinematics);
            let here = of(group, &rod.start).max(of(group, &rod.end)) + rod.radius;
            if let Some(most) = out.get_mut(group) {
                *most = most.max(here);
            }
        }
    }

    /// Only the pairs for which `keep` is true.
    #[must_use]
    pub fn filtered(&self, keep: impl Fn(Thing, Thing) -> bool) -> Self {
        let mut inner = (*self.inner).clone();
        let things = &inner.things;
        inner.pairs.retain(|[a, b]| keep(things[*a as usize], things[*b as usize]));
        for (first, list) in things.iter().zip(&mut inner.beside) {
            list.retain(|solid| keep(*first, Thing::Obstacle(inner.solids[*solid as usize].obstacle)));
        }
        Self { inner: Arc::new(inner) }
    }

    /// All pairs that are checked.
    pub fn pairs(&self) -> Vec<(Thing, Thing)> {
        let inner = &*self.inner;
        let mut out: Vec<(Thing, Thing)> = inner
            .pairs
            .iter()
            .map(|pair| (inner.things[pair[0] as usize], inner.things[pair[1] as usize]))
            .collect();
        for (first, list) in inner.things.iter().zip(&inner.beside) {
            let obstacle = |solid: &u32| Thing::Obstacle(inner.solids[*solid as usize].obstacle);
            out.extend(list.iter().map(|solid| (*first, obstacle(solid))));
        }
        out.sort_unstable();
        out.dedup();
        out
    }
}

/// Pairs of names as things: the first is carried by the arm, the second an obstacle or a link.
fn allowed(chain: &Chain, links: &LinkGeometry, scene: &Scene) -> Result<HashSet<(Thing, Thing)>> {
    let mut out = HashSet::new();
    for pair in scene.allowed() {
        // A name may be that of several obstacles, and of a link without a shape.
        let named = pair.each_ref().map(|name| -> Result<Vec<Thing>> {
            let link = links.names().iter().position(|known| known == name).map(Thing::Link);
            let same = |i: &usize| scene.obstacles()[*i].name.as_ref() == Some(name);
            let obstacles = (0..scene.obstacles().len()).filter(same).map(Thing::Obstacle);
            let found: Vec<Thing> = link.into_iter().chain(obstacles).collect();
            if found.is_empty() && chain.links().iter().all(|link| link.name != *name) {
                let mut valid: Vec<String> = links.names().to_vec();
                valid.extend(scene.obstacles().iter().filter_map(|o| o.name.clone()));
                return Err(Error::UnknownName {
                    kind: "link or obstacle in allowed",
                    name: name.clone(),
                    valid,
                });
            }
            Ok(found)
        });
        let [first, second] = named;
        for a in &first? {
            for b in second.as_ref().map_err(Clone::clone)? {
                out.insert((*a, *b));
                out.insert((*b, *a));
            }
        }
    }
    Ok(out)
}

impl Inner {
    fn of(&self, thing: Thing) -> impl Iterator<Item = usize> {
        (0..self.things.len()).filter(move |i| self.things[*i] == thing)
    }

    /// Pairs all shapes of two things.
    fn pair_all(&mut self, first: Thing, second: Thing) {
        let mut new = Vec::new();
        for a in self.of(first) {
            for b in self.of(second) {
                let later = self.bodies[a].joints_before >= self.bodies[b].joints_before;
                new.push(if later { [a as u32, b as u32] } else { [b as u32, a as u32] });
            }
        }
        self.pairs.extend(new);
    }

    fn add_obstacles(&mut self, scene: &Scene, allowed: &HashSet<(Thing, Thing)>) -> Result<()> {
        let mut carried: Vec<(Thing, usize)> = Vec::new();
        for (i, (obstacle, solids)) in scene.obstacles().iter().zip(scene.solids()).enumerate() {
            self.carriers.push(None);
            let Some(link) = &obstacle.attached_to else {
                let world = solids.iter().map(|solid| WorldSolid {
                    solid: solid.clone(),
                    obstacle: i,
                    velocity: obstacle.velocity,
                });
                self.solids.extend(world);
                continue;
            };
            let index = self.chain.link_index(link)?;
            let group = self.chain.links()[index].joints_before;
            for solid in solids {
                self.bodies.push(Body::on_link(&self.chain, index, i, solid.clone())?);
                self.things.push(Thing::Obstacle(i));
            }
            let known = self.names.iter().position(|name| name == link);
            self.carriers[i] = Some(known.unwrap_or_else(|| {
                self.names.push(link.clone());
                self.names.len() - 1
            }));
            carried.push((Thing::Obstacle(i), group));
        }
        // What is carried beside the links and beside other things that are carried.
        let links: Vec<(Thing, usize)> =
            (0..self.links.names().len()).map(|i| (Thing::Link(i), self.links.group(i))).collect();
        for (i, (thing, group)) in carried.iter().enumerate() {
            for (other, its) in links.iter().chain(&carried[i + 1..]) {
                if group != its && !allowed.contains(&(*thing, *other)) {
                    self.pair_all(*thing, *other);
                }
            }
        }
        for first in &self.things {
            let may = |world: &WorldSolid| allowed.contains(&(*first, Thing::Obstacle(world.obstacle)));
            let solids = (0..self.solids.len() as u32).filter(|i| !may(&self.solids[*i as usize]));
            self.beside.push(solids.collect());
        }
        Ok(())
    }

    /// Capsules around all bodies, and those that are drawn out, at one configuration.
    fn prepare(&self, kinematics: &Kinematics<'_>, rods: &mut Vec<Rod>, drawn: &mut Vec<Option<Solid>>) {
        for body in &self.bodies {
            rods.push(body.rod(kinematics));
            if body.telescope {
                drawn.resize(rods.len(), None);
                drawn[rods.len() - 1] = body.drawn_out(kinematics);
            }
        }
    }

    /// One direction for each pair, in the order of a scan.
    fn directions<'m>(&self, memory: &'m mut Vec<Vector3<f64>>) -> &'m mut [Vector3<f64>] {
        let count = self.pairs.len() + self.beside.iter().map(Vec::len).sum::<usize>();
        if memory.len() < count {
            memory.resize(count, Vector3::zeros());
        }
        &mut memory[..count]
    }

    /// A body and its frame.
    #[inline(always)]
    fn placed<'a>(
        &'a self,
        index: usize,
        kinematics: &Kinematics<'_>,
        drawn: &'a [Option<Solid>],
    ) -> (&'a Solid, Placement) {
        match drawn.get(index) {
            Some(Some(solid)) => (solid, Placement::world()),
            _ => (&self.bodies[index].solid, self.bodies[index].placement(kinematics)),
        }
    }

    /// How near a body is to another one, below `upto`.
    #[inline]
    fn between(
        &self,
        [a, b]: [u32; 2],
        kinematics: &Kinematics<'_>,
        upto: f64,
        (rods, drawn): (&[Rod], &[Option<Solid>]),
        memory: PairMemory<'_>,
    ) -> Option<Gap> {
        let (a, b) = (a as usize, b as usize);
        if self.bodies[a].is_capsule() && self.bodies[b].is_capsule() {
            // The capsules around them are themselves.
            let Rod { start, end, radius } = rods[b];
            let near = to_capsule(&rods[a].start, &rods[a].end, &Capsule { start, end, radius });
            return Some(from_nearest(&near, rods[a].radius)).filter(|gap| gap.distance < upto);
        }
        if rods_apart(&rods[a], &rods[b]) >= upto {
            return None;
        }
        let (first, second) = (self.placed(a, kinematics, drawn), self.placed(b, kinematics, drawn));
        near((first.0, &first.1), (second.0, &second.1), upto, memory)
    }

    /// How near a body is to a shape of the world, below `upto`.
    #[inline]
    fn beside(
        &self,
        a: usize,
        world: &WorldSolid,
        (kinematics, t): (&Kinematics<'_>, f64),
        upto: f64,
        (rods, drawn): (&[Rod], &[Option<Solid>]),
        memory: PairMemory<'_>,
    ) -> Option<Gap> {
        let rod = &rods[a];
        let shift = world.velocity * t;
        let apart = 0.5 * (rod.start + rod.end) - world.solid.ball.0 - shift;
        let far = upto + world.solid.ball.1 + rod.radius + 0.5 * (rod.end - rod.start).norm();
        // Where far is negative, upto lets contact alone count.
        if far < 0.0 || apart.norm_squared() >= far * far {
            return None;
        }
        let round = self.bodies[a].is_capsule();
        if round && has_closed_form(&world.solid) {
            let near = to_solid(&rod.start, &rod.end, &world.solid, &shift);
            return Some(from_nearest(&near, rod.radius)).filter(|gap| gap.distance < upto);
        }
        let place = Placement { origin: shift, ..Placement::world() };
        if !round && rods_apart(rod, &place.rod(&world.solid.rod)) >= upto {
            return None;
        }
        let (solid, frame) = self.placed(a, kinematics, drawn);
        near((solid, &frame), (&world.solid, &place), upto, memory)
    }
}

/// Memory for a pair, and the direction in which it was apart before.
type PairMemory<'a> = (&'a mut Memory, Option<&'a mut Vector3<f64>>);

/// How near two solids are, below `upto`.
#[inline]
fn near(
    a: (&Solid, &Placement),
    b: (&Solid, &Placement),
    upto: f64,
    (memory, shown): PairMemory<'_>,
) -> Option<Gap> {
    memory.direction = shown.as_deref().copied().unwrap_or_default();
    let found = gap(a, b, upto, memory).filter(|gap| gap.distance < upto);
    if let Some(shown) = shown {
        *shown = memory.direction;
    }
    found
}

impl Proximity for Surroundings {
    fn chain(&self) -> &Chain {
        &self.inner.chain
    }

    fn name(&self, thing: Thing) -> String {
        match thing {
            Thing::Link(i) => self.inner.names.get(i).cloned().unwrap_or_default(),
            Thing::Obstacle(i) => {
                let obstacle = self.inner.scene.as_ref().and_then(|scene| scene.obstacles().get(i));
                obstacle.map_or_else(String::new, |obstacle| obstacle.label(i))
            }
        }
    }

    fn links(&self) -> usize {
        self.inner.names.len()
    }

    fn moves(&self) -> bool {
        self.inner.moves
    }

    fn scan(
        &self,
        kinematics: &Kinematics<'_>,
        t: f64,
        memory: &mut ProximityMemory,
        visitor: &mut dyn Visitor,
    ) -> bool {
        let inner = &*self.inner;
        let ProximityMemory { convex, rods, drawn, directions } = memory;
        rods.clear();
        drawn.clear();
        inner.prepare(kinematics, rods, drawn);
        convex.contact_only = visitor.contact_only();
        let mut directions = inner.directions(directions).iter_mut();
        for pair in &inner.pairs {
            let [a, b] = pair.map(|i| i as usize);
            let (first, second) = (inner.things[a], inner.things[b]);
            let limit = visitor.limit(first, second);
            let shown = directions.next();
            if let Some(gap) = inner.between(*pair, kinematics, limit, (rods, drawn), (convex, shown)) {
                let bodies = (&inner.bodies[a], Some(&inner.bodies[b]));
                if !visitor.found(&Contact::new(first, second, gap, bodies, Vector3::zeros())) {
                    return false;
                }
            }
        }
        for (a, (first, list)) in inner.things.iter().zip(&inner.beside).enumerate() {
            for solid in list {
                let world = &inner.solids[*solid as usize];
                let second = Thing::Obstacle(world.obstacle);
                let limit = visitor.limit(*first, second);
                let memory = (&mut *convex, directions.next());
                if let Some(gap) = inner.beside(a, world, (kinematics, t), limit, (rods, drawn), memory) {
                    let bodies = (&inner.bodies[a], None);
                    if !visitor.found(&Contact::new(*first, second, gap, bodies, world.velocity)) {
                        return false;
                    }
                }
            }
        }
        true
    }

    fn prove(
        &self,
        ends: [(&Kinematics<'_>, f64); 2],
        steps: &[f64],
        by: f64,
        memory: &mut ProximityMemory,
    ) -> Proof {
        let inner = &*self.inner;
        let ProximityMemory { convex, rods, drawn, directions } = memory;
        rods.clear();
        drawn.clear();
        // What is nearer than `by` is a hit, however deep.
        convex.contact_only = by >= 0.0;
        let mut directions = inner.directions(directions).iter_mut();
        inner.prepare(ends[0].0, rods, drawn);
        let n = rods.len();
        inner.prepare(ends[1].0, rods, drawn);
        let (rods, later_rods) = rods.split_at(n);
        let (drawn, later_drawn) = drawn.split_at(n.min(drawn.len()));
        let memories = [(rods, drawn), (later_rods, later_drawn)];
        let mut open = None;
        for pair in &inner.pairs {
            let [a, b] = pair.map(|i| i as usize);
            let (body, shared) = (&inner.bodies[a], inner.bodies[b].joints_before);
            let travel: f64 = (shared..body.joints_before).map(|j| body.reach[j] * steps[j]).sum();
            let things = (inner.things[a], inner.things[b]);
            let mut shown = directions.next();
            let mut at = |end: usize, upto: f64| {
                let memory = (&mut *convex, shown.as_deref_mut());
                inner.between(*pair, ends[end].0, upto, memories[end], memory).map(|gap| gap.distance)
            };
            match proof(travel, by, &mut at) {
                Step::Clear => {}
                Step::Open => open = open.or(Some(things)),
                Step::Hit(end) => return Proof::Hit { first: things.0, second: things.1, end },
            }
        }
        for (a, (first, list)) in inner.things.iter().zip(&inner.beside).enumerate() {
            let body = &inner.bodies[a];
            let turned: f64 = body.reach.iter().zip(steps).map(|(reach, step)| reach * step).sum();
            for solid in list {
                let world = &inner.solids[*solid as usize];
                let travel = turned + world.velocity.norm() * (ends[1].1 - ends[0].1).abs();
                let things = (*first, Thing::Obstacle(world.obstacle));
                let mut shown = directions.next();
                let mut at = |end: usize, upto: f64| {
                    let memory = (&mut *convex, shown.as_deref_mut());
                    inner.beside(a, world, ends[end], upto, memories[end], memory).map(|gap| gap.distance)
                };
                match proof(travel, by, &mut at) {
                    Step::Clear => {}
                    Step::Open => open = open.or(Some(things)),
                    Step::Hit(end) => return Proof::Hit { first: things.0, second: things.1, end },
                }
            }
        }
        open.map_or(Proof::Clear, |(first, second)| Proof::Open { first, second })
    }
}

enum Step {
    Clear,
    Open,
    Hit(usize),
}

/// What the distances at both ends say about a pair that moves by at most `travel` in between: `at` gives the distance at
/// an end, or nothing where it is at least what is asked for.
#[inline(always)]
fn proof(travel: f64, by: f64, at: &mut dyn FnMut(usize, f64) -> Option<f64>) -> Step {
    // d_0 + d_1 > travel + 2 by proves it.
    let Some(first) = at(0, travel + by) else {
        // Nothing gets nearer than by: but the end itself has to be clear too, which follows.
        return Step::Clear;
    };
    if first < by {
        return Step::Hit(0);
    }
    let enough = travel + 2.0 * by - first;
    match at(1, enough.max(by)) {
        None => Step::Clear,
        Some(second) if second < by => Step::Hit(1),
        Some(second) if second >= enough => Step::Clear,
        Some(_) => Step::Open,
    }
}
