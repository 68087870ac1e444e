//! The room `rotation`: quaternions, sets of orientations, the best orientation.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, missing_docs)]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use redundancy_core::nalgebra::{Quaternion, UnitQuaternion};

mod cone;
mod optimize;
mod orientation_set;
mod quaternion;
mod volume;

/// Whether the heavy checks run in full size.
pub fn full() -> bool {
    std::env::var("REDUNDANCY_TEST_FULL").is_ok_and(|v| v == "1")
}

/// Seeded numbers.
pub struct Random(ChaCha8Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform(0.0, 1.0)).ln()).sqrt()
            * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }

    pub fn direction(&mut self) -> [f64; 3] {
        let v = [self.normal(), self.normal(), self.normal()];
        let n = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        v.map(|x| x / n)
    }

    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(Quaternion::new(
            self.normal(),
            self.normal(),
            self.normal(),
            self.normal(),
        ))
    }
}
