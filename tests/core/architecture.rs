//! The layout of the core, read from its sources: who may import whom, how long a file may be.
//!
//! Imports are all paths that begin with `crate`, `super`, `self` or a module of the file, in `use` lines and inline. A name
//! that a module re-exports counts for the file that defines it, so `mod.rs` files are no detours.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Left of all rooms: every file may import them.
const ROOT: [&str; 6] = ["status", "error", "tolerance", "watch", "parallel", "pose"];

/// Rooms from left to right; those of one row do not import each other.
const ROOMS: [&[&str]; 9] = [
    &["rotation"],
    &["joint_space"],
    &["chain"],
    &["kinematics"],
    &["path", "scene"],
    &["criterion"],
    &["solutions"],
    &["ik", "velocity", "optimum", "timing"],
    &["planning", "streaming"],
];

/// Longest file, in lines.
const LONGEST: usize = 800;

/// Names of types that say too little to be used for more than one thing.
const USED_ONCE: [&str; 8] =
    ["Problem", "Line", "Search", "State", "Grid", "Candidate", "Sinusoid", "Circle"];

/// `chain::joint` of `chain/joint.rs` and `chain` of `chain/mod.rs`; empty for `lib.rs`.
type Module = Vec<String>;

/// Names, `::`, and single characters; without comments, strings and what only tests compile.
struct Tokens(Vec<String>);

impl Tokens {
    fn of(text: &str) -> Self {
        let text: Vec<char> = text.chars().collect();
        let at = |i: usize| text.get(i).copied().unwrap_or('\0');
        let (mut tokens, mut i) = (Vec::new(), 0);
        while i < text.len() {
            match at(i) {
                '/' if at(i + 1) == '/' => {
                    while i < text.len() && at(i) != '\n' {
                        i += 1;
                    }
                }
                '/' if at(i + 1) == '*' => {
                    while i < text.len() && !(at(i) == '*' && at(i + 1) == '/') {
                        i += 1;
                    }
                    i += 2;
                }
                'r' if at(i + 1) == '"' || (at(i + 1) == '#' && (at(i + 2) == '"' || at(i + 2) == '#')) => {
                    let hashes = (i + 1..).take_while(|j| at(*j) == '#').count();
                    i += hashes + 2;
                    while i < text.len() && !(at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#')) {
                        i += 1;
                    }
                    i += hashes + 1;
                }
                '"' => {
                    i += 1;
                    while i < text.len() && at(i) != '"' {
                        i += if at(i) == '\\' { 2 } else { 1 };
                    }
                    i += 1;
                }
                // A character; a lifetime is a quote and a name.
                '\'' if at(i + 1) == '\\' => {
                    i += 3;
                    while at(i) != '\'' {
                        i += 1;
                    }
                    i += 1;
                }
                '\'' if at(i + 2) == '\'' => i += 3,
                c if c.is_alphanumeric() || c == '_' => {
                    let start = i;
                    while at(i).is_alphanumeric() || at(i) == '_' {
                        i += 1;
                    }
                    tokens.push(text[start..i].iter().collect());
                }
                ':' if at(i + 1) == ':' => {
                    tokens.push("::".to_owned());
                    i += 2;
                }
                c => {
                    if !c.is_whitespace() {
                        tokens.push(c.to_string());
                    }
                    i += 1;
                }
            }
        }
        Self(tokens).without_tests()
    }

    /// Without the modules under `#[cfg(test)]`.
    fn without_tests(self) -> Self {
        let mark = ["#", "[", "cfg", "(", "test", ")", "]", "mod"];
        let (mut kept, mut i) = (Vec::new(), 0);
        while i < self.0.len() {
            if self.0[i..].starts_with(&mark.map(String::from)) {
                i += mark.len();
                i = self.after_block(i);
                continue;
            }
            kept.push(self.0[i].clone());
            i += 1;
        }
        Self(kept)
    }

    /// Behind the next block in braces, or the next `;` where that comes first.
    fn after_block(&self, mut i: usize) -> usize {
        let mut depth = 0usize;
        while i < self.0.len() {
            match self.0[i].as_str() {
                "{" => depth += 1,
                "}" if depth == 1 => return i + 1,
                "}" => depth -= 1,
                ";" if depth == 0 => return i + 1,
                _ => {}
            }
            i += 1;
        }
        i
    }

    fn is(&self, i: usize, what: &str) -> bool {
        self.0.get(i).is_some_and(|token| token == what)
    }

    fn is_name(&self, i: usize) -> bool {
        self.0.get(i).is_some_and(|t| t.starts_with(|c: char| c.is_alphabetic() || c == '_'))
    }
}

/// A path as it is written, in the module where it is written, with the name it gets there.
#[derive(Clone, Debug)]
struct Written {
    place: Module,
    path: Vec<String>,
    name: String,
}

#[derive(Default)]
struct File {
    /// Relative to `src`.
    name: String,
    lines: usize,
    imports: Vec<Written>,
    /// `pub use` and `pub(crate) use`.
    exports: Vec<Written>,
    /// Types that it defines.
    types: Vec<String>,
    says_rayon: bool,
}

impl File {
    fn read(module: &Module, name: String, text: &str) -> Self {
        let tokens = Tokens::of(text);
        let mut file = Self { name, lines: text.lines().count(), ..Self::default() };
        file.says_rayon = tokens.0.iter().any(|token| token == "rayon");
        // Inline modules that are open, with the depth of their braces.
        let mut open: Vec<(String, usize)> = Vec::new();
        let (mut depth, mut i, mut public) = (0, 0, false);
        while i < tokens.0.len() {
            let place = || module.iter().cloned().chain(open.iter().map(|o| o.0.clone())).collect::<Module>();
            match tokens.0[i].as_str() {
                "pub" => {
                    public = true;
                    i += 1;
                    if tokens.is(i, "(") {
                        while !tokens.is(i, ")") {
                            i += 1;
                        }
                        i += 1;
                    }
                    continue;
                }
                "use" => {
                    let mut paths = Vec::new();
                    i = tree(&tokens, i + 1, &[], &mut paths);
                    let place = place();
                    let written =
                        paths.into_iter().map(|(path, name)| Written { place: place.clone(), path, name });
                    if public { file.exports.extend(written) } else { file.imports.extend(written) }
                }
                "struct" | "enum" | "trait" | "type" if depth == open.len() && tokens.is_name(i + 1) => {
                    file.types.push(tokens.0[i + 1].clone());
                    i += 2;
                }
                "mod" if tokens.is(i + 2, "{") => {
                    depth += 1;
                    open.push((tokens.0[i + 1].clone(), depth));
                    i += 3;
                }
                "{" => {
                    depth += 1;
                    i += 1;
                }
                "}" => {
                    if open.last().is_some_and(|o| o.1 == depth) {
                        open.pop();
                    }
                    depth -= 1;
                    i += 1;
                }
                "crate" | "super" | "self" if tokens.is(i + 1, "::") => {
                    let mut path = vec![tokens.0[i].clone()];
                    while tokens.is(i + 1, "::") && tokens.is_name(i + 2) {
                        path.push(tokens.0[i + 2].clone());
                        i += 2;
                    }
                    file.imports.push(Written { place: place(), path, name: String::new() });
                    i += 1;
                }
                // `name::...` where the name is no part of a longer path: a module of this file, perhaps.
                _ if tokens.is_name(i) && tokens.is(i + 1, "::") && !(i > 0 && tokens.is(i - 1, "::")) => {
                    let mut path = vec![tokens.0[i].clone()];
                    while tokens.is(i + 1, "::") && tokens.is_name(i + 2) {
                        path.push(tokens.0[i + 2].clone());
                        i += 2;
                    }
                    file.imports.push(Written { place: place(), path, name: String::new() });
                    i += 1;
                }
                _ => i += 1,
            }
            public = false;
        }
        file
    }
}

/// Reads a tree of `use` from token `i` on behind `prefix`; returns the token behind it.
fn tree(tokens: &Tokens, mut i: usize, prefix: &[String], out: &mut Vec<(Vec<String>, String)>) -> usize {
    let mut path = prefix.to_vec();
    loop {
        if tokens.is(i, "{") {
            i += 1;
            while !tokens.is(i, "}") {
                i = tree(tokens, i, &path, out);
                if tokens.is(i, ",") {
                    i += 1;
                }
            }
            return i + 1;
        }
        if tokens.is_name(i) || tokens.is(i, "*") {
            // `a::{self}` is `a`.
            if !tokens.is(i, "self") || path.is_empty() {
                path.push(tokens.0[i].clone());
            }
        }
        i += 1;
        if tokens.is(i, "::") {
            i += 1;
            continue;
        }
        let mut name = path.last().cloned().unwrap_or_default();
        if tokens.is(i, "as") {
            name.clone_from(&tokens.0[i + 1]);
            i += 2;
        }
        out.push((path, name));
        return i;
    }
}

struct Core {
    files: BTreeMap<Module, File>,
}

impl Core {
    fn read() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let mut files = BTreeMap::new();
        for path in sources(&root) {
            let name = path.strip_prefix(&root).unwrap().to_str().unwrap().replace('\\', "/");
            let text = fs::read_to_string(&path).unwrap();
            files.insert(module(&name), (name, text));
        }
        Self::new(files)
    }

    fn new(texts: BTreeMap<Module, (String, String)>) -> Self {
        let read = |(module, (name, text)): (Module, (String, String))| {
            let file = File::read(&module, name, &text);
            (module, file)
        };
        Self { files: texts.into_iter().map(read).collect() }
    }

    /// The file that defines what a path leads to; none outside of the crate.
    fn definition(&self, written: &Written) -> Option<&Module> {
        let mut here = written.place.clone();
        let mut rest = written.path.as_slice();
        match rest.first()?.as_str() {
            "crate" => {
                here.clear();
                rest = &rest[1..];
            }
            "self" => rest = &rest[1..],
            "super" => {
                while let Some((first, others)) = rest.split_first()
                    && first == "super"
                {
                    here.pop()?;
                    rest = others;
                }
            }
            // Beside a module of the file it is a crate, or a name that another import brought.
            first => {
                let mut child = here.clone();
                child.push(first.to_owned());
                self.files.get(&child)?;
            }
        }
        self.walk(here, rest, 0)
    }

    fn walk(&self, mut here: Module, rest: &[String], depth: usize) -> Option<&Module> {
        for (i, name) in rest.iter().enumerate() {
            let mut child = here.clone();
            child.push(name.clone());
            if self.files.contains_key(&child) {
                here = child;
                continue;
            }
            let exported = self.file_of(&here).and_then(|(_, file)| {
                file.exports.iter().find(|export| export.name == *name && export.place == here)
            });
            if let Some(export) = exported.filter(|_| depth < 8) {
                let mut onward = export.clone();
                onward.path.extend_from_slice(&rest[i + 1..]);
                if let Some(found) = self.definition_from(&onward, depth + 1) {
                    return Some(found);
                }
            }
            break;
        }
        self.file_of(&here).map(|(module, _)| module)
    }

    fn definition_from(&self, written: &Written, depth: usize) -> Option<&Module> {
        if depth > 8 { None } else { self.definition(written) }
    }

    /// The file of a module, which may be an inline one.
    fn file_of(&self, module: &Module) -> Option<(&Module, &File)> {
        (0..=module.len()).rev().find_map(|n| self.files.get_key_value(&module[..n]))
    }

    /// Names of importing and imported files, without `lib.rs`.
    fn edges(&self) -> BTreeSet<(&str, &str)> {
        let mut edges = BTreeSet::new();
        for (module, file) in self.files.iter().filter(|(module, _)| !module.is_empty()) {
            for to in file.imports.iter().filter_map(|import| self.definition(import)) {
                if to != module && !to.is_empty() {
                    edges.insert((file.name.as_str(), self.files[to].name.as_str()));
                }
            }
        }
        edges
    }
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (folders, files): (Vec<PathBuf>, Vec<PathBuf>) = entries.partition(|path| path.is_dir());
    let files = files.into_iter().filter(|path| path.extension().is_some_and(|e| e == "rs"));
    files.chain(folders.iter().flat_map(|folder| sources(folder))).collect()
}

fn module(name: &str) -> Module {
    let mut module: Module = name.trim_end_matches(".rs").split('/').map(String::from).collect();
    if module.last().is_some_and(|last| last == "mod" || last == "lib") {
        module.pop();
    }
    module
}

/// 0 for the files at the root, then the row of the room, from 1 on.
fn row(name: &str) -> Option<usize> {
    let first = name.split('/').next()?.trim_end_matches(".rs");
    if ROOT.contains(&first) {
        return Some(0);
    }
    ROOMS.iter().position(|rooms| rooms.contains(&first)).map(|row| row + 1)
}

/// Imports that do not lead to the left, or stay in the room.
fn wrong_way<'a>(edges: &BTreeSet<(&'a str, &'a str)>) -> Vec<(&'a str, &'a str)> {
    let room = |name: &str| name.split('/').next().map(String::from);
    let wrong = |(from, to): &&(&str, &str)| match (row(from), row(to)) {
        (Some(0), Some(0)) => false,
        (Some(from_row), Some(to_row)) => to_row >= from_row && room(from) != room(to),
        _ => true,
    };
    edges.iter().filter(wrong).copied().collect()
}

/// Imports between files that reach each other.
fn cycles<'a>(edges: &BTreeSet<(&'a str, &'a str)>) -> Vec<(&'a str, &'a str)> {
    let mut next: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (from, to) in edges {
        next.entry(*from).or_default().push(*to);
    }
    let reaches = |from: &str, goal: &str| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
        while let Some(file) = open.pop() {
            if file == goal {
                return true;
            }
            if seen.insert(file.to_owned()) {
                open.extend(next.get(file).into_iter().flatten());
            }
        }
        false
    };
    edges.iter().filter(|(from, to)| reaches(to, from)).copied().collect()
}

fn listed(pairs: &[(&str, &str)]) -> String {
    pairs.iter().map(|(from, to)| format!("\n  {from} imports {to}")).collect()
}

#[test]
fn imports_lead_to_the_left() {
    let core = Core::read();
    let unplaced: Vec<&str> =
        core.files.values().map(|f| f.name.as_str()).filter(|n| *n != "lib.rs" && row(n).is_none()).collect();
    assert!(unplaced.is_empty(), "no room of ROOMS: {unplaced:?}");
    let edges = core.edges();
    let wrong = wrong_way(&edges);
    assert!(wrong.is_empty(), "a room imports only from rooms to its left:{}", listed(&wrong));
}

#[test]
fn no_import_cycle_between_files() {
    let core = Core::read();
    let edges = core.edges();
    assert!(edges.len() > 200, "only {} imports were found", edges.len());
    let found = cycles(&edges);
    assert!(found.is_empty(), "files import each other in a circle:{}", listed(&found));
}

#[test]
fn no_file_grows_too_long() {
    let core = Core::read();
    for file in core.files.values() {
        assert!(file.lines <= LONGEST, "{} has {} lines, at most {LONGEST}", file.name, file.lines);
    }
}

#[test]
fn a_vague_name_stands_for_one_thing() {
    let core = Core::read();
    assert!(core.files.values().map(|file| file.types.len()).sum::<usize>() > 200);
    for name in USED_ONCE {
        let defines = |file: &&File| file.types.iter().any(|known| known == name);
        let files: Vec<&str> = core.files.values().filter(defines).map(|file| file.name.as_str()).collect();
        assert!(files.len() < 2, "{name} is defined in {files:?}: say what each of them holds");
    }
}

#[test]
fn only_one_file_knows_rayon() {
    let core = Core::read();
    let by_name = |file: &&File| file.says_rayon;
    let names: Vec<&str> = core.files.values().filter(by_name).map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["parallel.rs"], "parallel work goes through crate::parallel::prelude");
}

/// The checks themselves, on sources made for them.
#[test]
fn the_reader_sees_what_it_should() {
    let text = |name: &str, text: &str| (module(name), (name.to_owned(), text.to_owned()));
    let core = Core::new(BTreeMap::from([
        text("lib.rs", "pub mod chain; mod error; pub use chain::Chain;"),
        text("error.rs", "// use crate::chain::Chain;\n"),
        text("chain/mod.rs", "mod arm; mod joint; pub use arm::{Arm as Chain, Link}; pub(crate) use joint::*;"),
        text("chain/arm.rs", "use super::joint::{self, Joint};\npub(in crate::planning) struct Arm<'a>(&'a str);"),
        text(
            "chain/joint.rs",
            "const QUOTE: char = '\"'; const T: &str = r#\"crate::ik::X\"#; fn f() -> crate::error::Error {}\n
             #[cfg(test)] mod tests { use crate::ik::Solver; }",
        ),
        text("ik/mod.rs", "mod solver; use std::fmt; use solver::Solver; fn g() { solver::h(); chain::i(); }"),
        text("ik/solver.rs", "use crate::{Chain, chain::Link};\nmod inner { use super::Link; use super::super::fmt; }"),
        text("path/mod.rs", "use crate::scene::Scene; use rayon::prelude::*;"),
        text("scene/mod.rs", "use crate::ik::solver as other; use crate::{path::Path, unheard::Of};"),
    ]));
    let edges = core.edges();
    let expected = BTreeSet::from([
        ("chain/arm.rs", "chain/joint.rs"),
        ("chain/joint.rs", "error.rs"),
        ("ik/mod.rs", "ik/solver.rs"),
        ("ik/solver.rs", "chain/arm.rs"),
        ("ik/solver.rs", "ik/mod.rs"),
        ("path/mod.rs", "scene/mod.rs"),
        ("scene/mod.rs", "ik/solver.rs"),
        ("scene/mod.rs", "path/mod.rs"),
    ]);
    assert_eq!(edges, expected);
    let wrong =
        [("path/mod.rs", "scene/mod.rs"), ("scene/mod.rs", "ik/solver.rs"), ("scene/mod.rs", "path/mod.rs")];
    assert_eq!(wrong_way(&edges), wrong);
    let circles = [
        ("ik/mod.rs", "ik/solver.rs"),
        ("ik/solver.rs", "ik/mod.rs"),
        ("path/mod.rs", "scene/mod.rs"),
        ("scene/mod.rs", "path/mod.rs"),
    ];
    assert_eq!(cycles(&edges), circles);
    let arm = &core.files[&module("chain/arm.rs")];
    assert_eq!(arm.types, ["Arm"]);
    let rayon: Vec<_> = core.files.values().filter(|file| file.says_rayon).map(|file| &file.name).collect();
    assert_eq!(rayon, ["path/mod.rs"]);
}
