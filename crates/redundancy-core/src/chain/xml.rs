//! Untrusted XML: bounds on what a parser's cost depends on more than linearly, and no document type definitions.

use roxmltree::{Document, ParsingOptions};

use crate::error::{Error, Result};
use crate::tolerance::{XML_ATTRIBUTES, XML_NAMESPACES};

/// Parses `xml` and hands the document to `read`. `what` names the format in messages.
///
/// # Errors
/// Text that is larger than `bytes` or has more than `nodes` nodes, has a document type definition, or is not well formed.
pub(crate) fn with_document<T>(
    what: &str,
    xml: &str,
    (bytes, nodes): (usize, u32),
    bad: impl Fn(String) -> Error,
    read: impl FnOnce(&Document<'_>) -> Result<T>,
) -> Result<T> {
    // Blank lines before the XML declaration are against the standard and common.
    let xml = xml.trim_start_matches('\u{feff}').trim_start();
    guard(what, xml, bytes)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: nodes, ..Default::default() };
    let document = Document::parse_with_options(xml, options).map_err(|error| match error {
        roxmltree::Error::DtdDetected => {
            bad("document type definitions (<!DOCTYPE ...>, entities) are refused; remove it".into())
        }
        other => bad(format!("not well-formed XML: {other}")),
    })?;
    read(&document)
}

fn guard(what: &str, xml: &str, bytes: usize) -> Result<()> {
    let check = |count: &str, value: usize, bound: usize| {
        if value <= bound {
            return Ok(());
        }
        Err(Error::OutOfRange {
            what: format!("{what}: {count}"),
            value: value as f64,
            bound: format!("<= {bound}"),
        })
    };
    check("number of bytes", xml.len(), bytes)?;
    check("number of namespace declarations", xml.matches("xmlns").count(), XML_NAMESPACES)?;
    let mut attributes = 0;
    let mut equals = false;
    for byte in xml.bytes() {
        match byte {
            b'<' => (attributes, equals) = (0, false),
            b'=' => equals = true,
            b'"' | b'\'' if equals => {
                attributes += 1;
                equals = false;
                check("number of attributes of one element", attributes, XML_ATTRIBUTES)?;
            }
            b' ' | b'\t' | b'\r' | b'\n' => {}
            _ => equals = false,
        }
    }
    Ok(())
}
