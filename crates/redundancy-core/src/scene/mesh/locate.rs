//! Where the file of a mesh is.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Environment variables with lists of folders that hold packages, and where in them.
const VARIABLES: [(&str, &str); 2] = [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")];

/// The file that a URDF in the folder `home` means by `name`.
///
/// - `package://P/rest` (or `model://`): `rest` in the package P, which is looked for in `package_dirs` and in the folders of
///   `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH` (a folder that holds P, or is P), then in the folders above `home`.
/// - `file:///path` and absolute names: that file.
/// - relative names: from `home`, then from each of `package_dirs`.
///
/// # Errors
/// No such file: the message names it and the places searched. `http://` and other schemes.
pub fn locate(name: &str, home: Option<&Path>, package_dirs: &[PathBuf]) -> Result<PathBuf> {
    let missing = |message: String| Error::File { file: name.into(), message };
    if name.contains('\0') {
        return Err(missing("the file name contains a zero byte".into()));
    }
    let mut candidates: Vec<PathBuf> = Vec::new();
    if let Some(rest) = strip(name, "package://").or_else(|| strip(name, "model://")) {
        let (package, file) = rest.split_once('/').unwrap_or((rest.as_str(), ""));
        if package.is_empty() || file.is_empty() {
            return Err(missing("expected package://<package>/<file>".into()));
        }
        let mut roots: Vec<PathBuf> = package_dirs.to_vec();
        for (variable, below) in VARIABLES {
            let list = std::env::var_os(variable).unwrap_or_default();
            roots.extend(
                std::env::split_paths(&list).filter(|p| !p.as_os_str().is_empty()).map(|p| p.join(below)),
            );
        }
        for root in roots.iter().map(PathBuf::as_path).chain(ancestors(home)) {
            candidates.push(root.join(package).join(file));
            if root.file_name() == Some(OsStr::new(package)) {
                candidates.push(root.join(file));
            }
        }
    } else if let Some(rest) = strip(name, "file://") {
        // file://localhost/path and file:///path are the same; some files have file://relative.
        let path = Path::new(rest.strip_prefix("localhost").unwrap_or(&rest));
        candidates.push(home.map_or_else(|| path.to_path_buf(), |home| home.join(path)));
    } else if let Some((scheme, _)) = name.split_once("://") {
        return Err(missing(format!("{scheme}:// is not read, only package://, file:// and names of files")));
    } else {
        candidates.push(home.map_or_else(|| PathBuf::from(name), |home| home.join(name)));
        candidates.extend(package_dirs.iter().map(|dir| dir.join(name)));
    }
    candidates.dedup();
    match candidates.iter().position(|path| path.is_file()) {
        Some(found) => Ok(candidates.swap_remove(found)),
        None => {
            let places: Vec<String> = candidates.iter().map(|path| path.display().to_string()).collect();
            let hint = if package_dirs.is_empty() {
                "; give the folder that contains the package as package_dirs (--package-dir)"
            } else {
                ""
            };
            Err(missing(format!("no such file; searched: {}{hint}", places.join(", "))))
        }
    }
}

/// What follows the scheme, with %-escapes decoded.
fn strip(name: &str, scheme: &str) -> Option<String> {
    let head = name.get(..scheme.len())?;
    if !head.eq_ignore_ascii_case(scheme) {
        return None;
    }
    let bytes = &name.as_bytes()[scheme.len()..];
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while let Some(byte) = bytes.get(i) {
        let hex = bytes.get(i + 1..i + 3).and_then(|pair| std::str::from_utf8(pair).ok());
        match hex.filter(|_| *byte == b'%').and_then(|pair| u8::from_str_radix(pair, 16).ok()) {
            Some(decoded) if decoded != 0 => {
                out.push(decoded);
                i += 3;
            }
            _ => {
                out.push(*byte);
                i += 1;
            }
        }
    }
    Some(String::from_utf8_lossy(&out).into_owned())
}

fn ancestors(home: Option<&Path>) -> impl Iterator<Item = &Path> {
    home.into_iter().flat_map(Path::ancestors).filter(|path| !path.as_os_str().is_empty())
}
