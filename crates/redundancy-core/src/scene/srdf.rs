//! Pairs of links from an SRDF file.

use std::collections::HashSet;
use std::path::Path;

use super::pairs::{Found, Links, Reason};
use crate::chain::xml;
use crate::error::{Error, Result};
use crate::tolerance::{URDF_BYTES, URDF_NODES};

/// What an SRDF file says about pairs of links.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Srdf {
    /// Pairs that are disabled.
    disabled: Vec<[String; 2]>,
    /// Links whose pairs are all disabled but the enabled ones.
    disabled_links: Vec<String>,
    enabled: Vec<[String; 2]>,
}

impl Srdf {
    /// From a file.
    ///
    /// # Errors
    /// A file that cannot be read, or as [`Srdf::from_xml`], with the file's name.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let broken = |message: String| Error::File { file: path.display().to_string(), message };
        let mut bytes = Vec::new();
        std::fs::File::open(path)
            .and_then(|f| {
                use std::io::Read;
                f.take(URDF_BYTES as u64 + 1).read_to_end(&mut bytes)
            })
            .map_err(|error| broken(error.to_string()))?;
        let text = String::from_utf8(bytes).map_err(|e| broken(format!("not UTF-8: {}", e.utf8_error())))?;
        Self::from_xml(&text).map_err(|error| broken(error.to_string()))
    }

    /// From text: `disable_collisions`, `disable_default_collisions` and `enable_collisions` count, everything else is left
    /// out.
    ///
    /// # Errors
    /// Text that is not well-formed XML or has a document type definition; a root other than `<robot>`; an element without its
    /// links.
    ///
    /// ```
    /// use redundancy_core::scene::Srdf;
    /// assert!(Srdf::from_xml(r#"<robot name="r"><disable_collisions link1="a" link2="b"/></robot>"#).is_ok());
    /// assert!(Srdf::from_xml(r#"<robot name="r"><disable_collisions link1="a"/></robot>"#).is_err());
    /// ```
    pub fn from_xml(text: &str) -> Result<Self> {
        let bad = |message: String| Error::Invalid(format!("SRDF: {message}"));
        xml::with_document("SRDF", text, (URDF_BYTES, URDF_NODES), bad, |document| {
            let root = document.root_element();
            if root.tag_name().name() != "robot" {
                let tag = root.tag_name().name();
                return Err(bad(format!("the root element is <{tag}>, expected <robot>")));
            }
            let mut srdf = Self::default();
            for node in root.children().filter(roxmltree::Node::is_element) {
                let tag = node.tag_name().name();
                let link = |name: &str| match node.attribute(name) {
                    Some(link) if !link.is_empty() => Ok(link.to_owned()),
                    _ => Err(bad(format!("<{tag}> has no {name}"))),
                };
                match tag {
                    "disable_collisions" => srdf.disabled.push([link("link1")?, link("link2")?]),
                    "enable_collisions" => srdf.enabled.push([link("link1")?, link("link2")?]),
                    "disable_default_collisions" => srdf.disabled_links.push(link("link")?),
                    _ => {}
                }
            }
            Ok(srdf)
        })
    }

    /// All pairs of links that move against each other but those that are disabled.
    pub(crate) fn apply(&self, links: &Links<'_>) -> Found {
        let index = |name: &String| links.names.iter().position(|known| known == name);
        let pairs = |list: &[[String; 2]]| -> HashSet<[usize; 2]> {
            let both = list.iter().filter_map(|[a, b]| Some([index(a)?, index(b)?]));
            both.map(|[a, b]| [a.min(b), a.max(b)]).collect()
        };
        let (disabled, enabled) = (pairs(&self.disabled), pairs(&self.enabled));
        let silent: Vec<bool> = links.names.iter().map(|name| self.disabled_links.contains(name)).collect();
        let mut found = Found::default();
        for pair in links.moving() {
            let off =
                disabled.contains(&pair) || (silent[pair[0]] || silent[pair[1]]) && !enabled.contains(&pair);
            if off {
                found.left_out.push((pair, Reason::User));
            } else {
                found.kept.push(pair);
            }
        }
        found
    }
}
