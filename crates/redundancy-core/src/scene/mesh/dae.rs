//! COLLADA: the polygons of all instances, placed by the transforms of their nodes, in metres.
//!
//! The scene is `<scene><instance_visual_scene>`; a file without one shows every visual scene, a file without those every
//! geometry once. Nodes may be instantiated again and again: the depth, the number of nodes visited and the size of the
//! result are bounded. Lines and points have no surface and are left out. The up axis is ignored.

use std::collections::HashMap;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node};

use super::text::{Raw, check_count, number, push_fan, shown};
use crate::chain::xml;
use crate::error::{Error, Result};
use crate::tolerance::{MESH_BYTES, MESH_NODES, MESH_VERTICES};

/// Deepest nesting of nodes, and most nodes visited.
const MAX_DEPTH: usize = 100;
const MAX_VISITS: usize = 100_000;
/// Most indices of one corner: position, normal, colours, textures.
const MAX_STRIDE: usize = 64;

pub fn read(bytes: &[u8]) -> Result<Raw> {
    let text = String::from_utf8_lossy(bytes);
    let limits = (usize::try_from(MESH_BYTES).unwrap_or(usize::MAX), MESH_NODES);
    xml::with_document("DAE", &text, limits, Error::Invalid, |document| {
        let root = document.root_element();
        if root.tag_name().name() != "COLLADA" {
            return Err(bad(format!("the root element is <{}>, expected <COLLADA>", root.tag_name().name())));
        }
        let mut reader = Reader::new(document);
        let unit = child(root, "asset").and_then(|asset| child(asset, "unit"));
        let meter = match unit.and_then(|unit| unit.attribute("meter")) {
            Some(word) => number(word.trim())?,
            None => 1.0,
        };
        if meter <= 0.0 {
            return Err(Error::OutOfRange { what: "unit meter".into(), value: meter, bound: "> 0".into() });
        }
        reader.scene(root, &Matrix4::new_scaling(meter))?;
        Ok((reader.vertices, reader.faces))
    })
}

fn bad(message: impl Into<String>) -> Error {
    Error::Invalid(message.into())
}

fn children<'a, 'x: 'a>(node: Node<'a, 'x>, name: &'static str) -> impl Iterator<Item = Node<'a, 'x>> {
    node.children().filter(move |n| n.is_element() && n.tag_name().name() == name)
}

fn child<'a, 'x: 'a>(node: Node<'a, 'x>, name: &'static str) -> Option<Node<'a, 'x>> {
    children(node, name).next()
}

struct Reader<'a, 'x> {
    by_id: HashMap<&'a str, Node<'a, 'x>>,
    /// Polygons of the geometries that were read, in their own coordinates.
    known: HashMap<&'a str, Raw>,
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    visits: usize,
}

impl<'a, 'x: 'a> Reader<'a, 'x> {
    fn new(document: &'a Document<'x>) -> Self {
        let with_id = document.descendants().filter_map(|node| Some((node.attribute("id")?, node)));
        let mut by_id = HashMap::new();
        for (id, node) in with_id {
            by_id.entry(id).or_insert(node);
        }
        Self { by_id, known: HashMap::new(), vertices: Vec::new(), faces: Vec::new(), visits: 0 }
    }

    /// The element that `#id` in an attribute names.
    fn target(&self, node: Node<'a, 'x>, attribute: &str, tag: &str) -> Result<(&'a str, Node<'a, 'x>)> {
        let name = node.tag_name().name();
        let word = node.attribute(attribute).ok_or_else(|| bad(format!("<{name}> has no {attribute}")))?;
        let id = word.strip_prefix('#').unwrap_or(word);
        match self.by_id.get(id) {
            Some(found) if found.tag_name().name() == tag => Ok((id, *found)),
            _ => Err(bad(format!("<{name} {attribute}=\"{}\">: there is no such <{tag}>", shown(word)))),
        }
    }

    fn scene(&mut self, root: Node<'a, 'x>, unit: &Matrix4<f64>) -> Result<()> {
        let shown = child(root, "scene").and_then(|scene| child(scene, "instance_visual_scene"));
        let scenes: Vec<Node> = match shown {
            Some(instance) => vec![self.target(instance, "url", "visual_scene")?.1],
            None => {
                children(root, "library_visual_scenes").flat_map(|l| children(l, "visual_scene")).collect()
            }
        };
        for scene in &scenes {
            for node in children(*scene, "node") {
                self.node(node, unit, 0)?;
            }
        }
        if scenes.is_empty() {
            let geometries = children(root, "library_geometries").flat_map(|l| children(l, "geometry"));
            for (i, geometry) in geometries.enumerate() {
                let polygons = self.geometry(geometry, &format!("geometry {i}"))?;
                self.place(&polygons, unit)?;
            }
        }
        Ok(())
    }

    fn node(&mut self, node: Node<'a, 'x>, above: &Matrix4<f64>, depth: usize) -> Result<()> {
        self.visits += 1;
        if depth > MAX_DEPTH || self.visits > MAX_VISITS {
            let bounds = format!("at most {MAX_DEPTH} levels and {MAX_VISITS} nodes");
            return Err(bad(format!("nodes are nested or repeated too often, {bounds} are read")));
        }
        let mut at = *above;
        for element in node.children().filter(Node::is_element) {
            if let Some(transform) = transform(element)? {
                at *= transform;
            }
        }
        for element in node.children().filter(Node::is_element) {
            match element.tag_name().name() {
                "node" => self.node(element, &at, depth + 1)?,
                "instance_node" => {
                    let (_, target) = self.target(element, "url", "node")?;
                    self.node(target, &at, depth + 1)?;
                }
                "instance_geometry" => {
                    let (id, geometry) = self.target(element, "url", "geometry")?;
                    let polygons = match self.known.remove(id) {
                        Some(known) => known,
                        None => self.geometry(geometry, &format!("geometry '{}'", shown(id)))?,
                    };
                    self.place(&polygons, &at)?;
                    self.known.insert(id, polygons);
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn place(&mut self, (vertices, faces): &Raw, at: &Matrix4<f64>) -> Result<()> {
        let first = self.vertices.len() as u32;
        check_count("vertices", self.vertices.len() + vertices.len(), MESH_VERTICES)?;
        check_count("faces", self.faces.len() + faces.len(), crate::tolerance::MESH_FACES)?;
        let mirrors = at.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        self.vertices.extend(
            vertices.iter().map(|v| -> [f64; 3] { at.transform_point(&Point3::from(*v)).coords.into() }),
        );
        self.faces.extend(faces.iter().map(|f| {
            let [a, b, c] = f.map(|i| i + first);
            if mirrors { [a, c, b] } else { [a, b, c] }
        }));
        Ok(())
    }

    /// The polygons of a geometry as triangles; none for splines and convex hulls of others.
    fn geometry(&self, geometry: Node<'a, 'x>, what: &str) -> Result<Raw> {
        let inside = |error: Error| bad(format!("{what}: {error}"));
        let mut out: Raw = (Vec::new(), Vec::new());
        let Some(mesh) = child(geometry, "mesh") else { return Ok(out) };
        let mut read: HashMap<&str, u32> = HashMap::new();
        for element in mesh.children().filter(Node::is_element) {
            let tag = element.tag_name().name();
            if !matches!(tag, "triangles" | "polylist" | "polygons" | "trifans" | "tristrips") {
                continue;
            }
            let layout = self.layout(element).map_err(inside)?;
            let Some(layout) = layout else { continue };
            // Positions are shared by the groups of polygons of a mesh, mostly.
            let first = match read.get(layout.positions) {
                Some(first) => *first,
                None => {
                    let first = out.0.len() as u32;
                    out.0.extend(self.positions(layout.positions).map_err(inside)?);
                    check_count("vertices", out.0.len(), MESH_VERTICES)?;
                    read.insert(layout.positions, first);
                    first
                }
            };
            let count = out.0.len() as u32 - first;
            polygons(element, tag, &layout, (first, count), &mut out.1).map_err(inside)?;
        }
        Ok(out)
    }

    /// Where the positions are among the indices of a corner; `None` for a group without input.
    fn layout(&self, group: Node<'a, 'x>) -> Result<Option<Layout<'a>>> {
        let (mut stride, mut vertex) = (0, None);
        for input in children(group, "input") {
            let offset: usize = match input.attribute("offset") {
                None => 0,
                Some(word) => {
                    let value = word.trim().parse().ok().filter(|offset| *offset < MAX_STRIDE);
                    value.ok_or_else(|| bad(format!("<input> has the offset '{}'", shown(word))))?
                }
            };
            stride = stride.max(offset + 1);
            if input.attribute("semantic") == Some("VERTEX") {
                vertex = Some((offset, input));
            }
        }
        let Some((offset, input)) = vertex else {
            return if stride == 0 { Ok(None) } else { Err(bad("a group of polygons has no VERTEX input")) };
        };
        let (_, vertices) = self.target(input, "source", "vertices")?;
        let position = children(vertices, "input").find(|i| i.attribute("semantic") == Some("POSITION"));
        let position = position.ok_or_else(|| bad("<vertices> has no POSITION input"))?;
        let (positions, _) = self.target(position, "source", "source")?;
        Ok(Some(Layout { stride, offset, positions }))
    }

    fn positions(&self, id: &str) -> Result<Vec<[f64; 3]>> {
        let Some(source) = self.by_id.get(id) else { return Err(bad("a source is missing")) };
        let accessor = child(*source, "technique_common").and_then(|t| child(t, "accessor"));
        let array = match accessor.filter(|a| a.attribute("source").is_some()) {
            Some(accessor) => self.target(accessor, "source", "float_array")?.1,
            None => child(*source, "float_array").ok_or_else(|| bad("a source has no <float_array>"))?,
        };
        let count = |node: Node, name: &str, missing: usize| -> Result<usize> {
            let Some(word) = node.attribute(name) else { return Ok(missing) };
            let tag = node.tag_name().name();
            word.trim().parse().map_err(|_| bad(format!("<{tag} {name}=\"{}\"> is no count", shown(word))))
        };
        let values = words(array).map(number).collect::<Result<Vec<f64>>>()?;
        let announced = count(array, "count", values.len())?;
        if announced != values.len() {
            return Err(bad(format!("<float_array> announces {announced} numbers and has {}", values.len())));
        }
        let (stride, offset, points) = match accessor {
            None => (3, 0, values.len() / 3),
            Some(node) => {
                let stride = count(node, "stride", 1)?;
                (stride, count(node, "offset", 0)?, count(node, "count", values.len() / stride.max(1))?)
            }
        };
        check_count("vertices", points, MESH_VERTICES)?;
        let last = points
            .checked_sub(1)
            .map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(offset)?.checked_add(3));
        if stride < 3 || last.is_none_or(|last| last > values.len()) {
            let actual = values.len();
            return Err(bad(format!("{points} points {stride} numbers apart do not fit {actual} numbers")));
        }
        let at = |i: usize| {
            let from = offset + i * stride;
            [values[from], values[from + 1], values[from + 2]]
        };
        Ok((0..points).map(at).collect())
    }
}

struct Layout<'a> {
    /// Indices of a corner, and which of them is that of the position.
    stride: usize,
    offset: usize,
    /// The source of the positions.
    positions: &'a str,
}

fn words<'a>(node: Node<'a, '_>) -> impl Iterator<Item = &'a str> {
    node.children().filter_map(|n| n.text()).flat_map(str::split_ascii_whitespace)
}

/// Adds the triangles of one group of polygons.
fn polygons(
    group: Node,
    tag: &str,
    layout: &Layout,
    (first, count): (u32, u32),
    faces: &mut Vec<[u32; 3]>,
) -> Result<()> {
    let mut corners = Vec::new();
    let mut read = |p: Node| -> Result<Vec<u32>> {
        corners.clear();
        let mut total = 0;
        for (i, word) in words(p).enumerate() {
            total = i + 1;
            if i % layout.stride == layout.offset {
                let index: u32 = word.parse().map_err(|_| bad(format!("'{}' is no index", shown(word))))?;
                if index >= count {
                    return Err(bad(format!("vertex {index} is not one of the {count} vertices")));
                }
                corners.push(index + first);
            }
        }
        if total % layout.stride != 0 {
            return Err(bad(format!("{total} indices are not a multiple of {} per corner", layout.stride)));
        }
        Ok(corners.clone())
    };
    for p in children(group, "p") {
        let corners = read(p)?;
        match tag {
            "triangles" => {
                if corners.len() % 3 != 0 {
                    return Err(bad(format!("{} corners are not a multiple of 3", corners.len())));
                }
                for triangle in corners.chunks_exact(3) {
                    push_fan(faces, triangle)?;
                }
            }
            "polylist" => polylist(group, &corners, faces)?,
            "polygons" | "trifans" if corners.len() >= 3 => push_fan(faces, &corners)?,
            "tristrips" => {
                for (i, w) in corners.windows(3).enumerate() {
                    push_fan(faces, &if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })?;
                }
            }
            _ => return Err(bad(format!("a polygon needs 3 corners, here it has {}", corners.len()))),
        }
    }
    // Polygons with holes: the outline without them.
    for outline in children(group, "ph").filter_map(|ph| child(ph, "p")) {
        let corners = read(outline)?;
        if corners.len() >= 3 {
            push_fan(faces, &corners)?;
        }
    }
    Ok(())
}

fn polylist(group: Node, corners: &[u32], faces: &mut Vec<[u32; 3]>) -> Result<()> {
    let Some(counts) = child(group, "vcount") else { return Err(bad("<polylist> has no <vcount>")) };
    let mut rest = corners;
    for word in words(counts) {
        let size: usize =
            word.parse().map_err(|_| bad(format!("'{}' is no count of corners", shown(word))))?;
        if size > rest.len() {
            return Err(bad(format!("<vcount> asks for more corners than the {} in <p>", corners.len())));
        }
        let (polygon, after) = rest.split_at(size);
        // Two corners are a line.
        if size >= 3 {
            push_fan(faces, polygon)?;
        }
        rest = after;
    }
    if !rest.is_empty() {
        return Err(bad(format!("<p> has {} corners more than <vcount> asks for", rest.len())));
    }
    Ok(())
}

/// The transform of an element inside of a node; `None` where it is none.
fn transform(element: Node) -> Result<Option<Matrix4<f64>>> {
    let tag = element.tag_name().name();
    fn values<const N: usize>(element: Node, tag: &str) -> Result<[f64; N]> {
        let list = words(element).take(N + 1).map(number).collect::<Result<Vec<f64>>>()?;
        let actual = list.len();
        list.try_into().map_err(|_| bad(format!("<{tag}> has {actual} numbers, expected {N}")))
    }
    Ok(Some(match tag {
        "matrix" => Matrix4::from_row_slice(&values::<16>(element, tag)?),
        "translate" => Matrix4::new_translation(&values::<3>(element, tag)?.into()),
        "scale" => Matrix4::new_nonuniform_scaling(&values::<3>(element, tag)?.into()),
        "rotate" => {
            let [x, y, z, degrees] = values::<4>(element, tag)?;
            let axis = Vector3::new(x, y, z);
            if axis.norm() == 0.0 {
                return Ok(None);
            }
            Rotation3::from_axis_angle(&Unit::new_normalize(axis), degrees.to_radians()).to_homogeneous()
        }
        "lookat" | "skew" => {
            return Err(bad(format!("<{tag}> is not read, only matrix, translate, rotate and scale")));
        }
        _ => return Ok(None),
    }))
}
