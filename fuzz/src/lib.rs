//! What has to hold for any input: properties of the readers and of the numeric entry points.
//!
//! Each function takes any bytes and panics where a property does not hold. The tests below run them on the
//! stored corpus and on seeded random bytes.

pub mod numeric;
pub mod readers;

/// A name, and the function that takes the bytes.
pub type Target = (&'static str, fn(&[u8]));

/// Every target by its name.
pub const TARGETS: [Target; 13] = [
    ("urdf", crate::readers::urdf),
    ("srdf", crate::readers::srdf),
    ("mesh", crate::readers::mesh),
    ("path_csv", crate::readers::path_csv),
    ("scene_json", crate::readers::scene_json),
    ("trajectory_json", crate::readers::trajectory_json),
    ("dh", crate::readers::dh),
    ("srs", crate::numeric::srs),
    ("panda_class", crate::numeric::panda_class),
    ("parallel_axes", crate::numeric::parallel_axes),
    ("spherical_wrist", crate::numeric::spherical_wrist),
    ("ik", crate::numeric::ik),
    ("velocity", crate::numeric::velocity),
];

/// Numbers taken from the bytes, one after the other.
pub struct Numbers<'a> {
    bytes: &'a [u8],
}

impl<'a> Numbers<'a> {
    /// From the start of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    /// The next byte; 0 at the end.
    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.bytes.split_first() else { return 0 };
        self.bytes = rest;
        *first
    }

    /// Any 64 bits as a number, infinities and NaN included; 0 at the end.
    pub fn raw(&mut self) -> f64 {
        let Some((first, rest)) = self.bytes.split_first_chunk::<8>() else { return 0.0 };
        self.bytes = rest;
        f64::from_le_bytes(*first)
    }

    /// A number in `[-1, 1]` from two bytes. The ends and the middle, where degenerate cases are, occur exactly.
    pub fn unit(&mut self) -> f64 {
        let code = i16::from_le_bytes([self.byte(), self.byte()]);
        f64::from(code.max(-32_767)) / 32_767.0
    }

    /// Whether bytes are left.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::TARGETS;

    #[test]
    fn the_corpus_holds_every_property() {
        for (name, target) in TARGETS {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
            let mut files = 0;
            for file in std::fs::read_dir(folder).unwrap() {
                target(&std::fs::read(file.unwrap().path()).unwrap());
                files += 1;
            }
            assert!(files > 0, "{name} has no corpus");
        }
    }

    #[test]
    fn random_bytes_hold_every_property() {
        let mut state = 1_u64;
        for (_, target) in TARGETS {
            for length in 0..100 {
                let bytes: Vec<u8> = (0..length)
                    .map(|_| {
                        state = state
                            .wrapping_mul(6_364_136_223_846_793_005)
                            .wrapping_add(1_442_695_040_888_963_407);
                        (state >> 56) as u8
                    })
                    .collect();
                target(&bytes);
            }
        }
    }
}
