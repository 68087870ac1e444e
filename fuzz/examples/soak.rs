//! The properties on mutated corpus files: `soak SECONDS SEED TARGET...`. Prints executions per target.
//!
//! It knows nothing of coverage, so it finds less than a fuzzer with an instrumented build would. The input is
//! written to `soak-TARGET-SEED.bin` when a property fails.

use std::panic::catch_unwind;
use std::path::Path;
use std::time::{Duration, Instant};

use redundancy_fuzz::TARGETS;

/// Pseudo-random numbers (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Pieces that readers treat in a special way.
const WORDS: [&str; 14] =
    ["-1", "0", "1e308", "nan", "inf", "1e-320", "\"", "<", ">", "{", "]", ",", "99999999999999999999", "\n"];

fn mutated(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len() + 1);
        match random.below(6) {
            0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            1 if at < bytes.len() => bytes[at] = random.next() as u8,
            2 => {
                let word = WORDS[random.below(WORDS.len())];
                bytes.splice(at..at, word.bytes());
            }
            3 => {
                let end = (at + random.below(24)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let other = &seeds[random.below(seeds.len())];
                let from = random.below(other.len());
                let to = (from + random.below(64)).min(other.len());
                bytes.splice(at..at, other[from..to].iter().copied());
            }
            _ => {
                // A number by another one.
                let word = WORDS[random.below(6)];
                if let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|i| i + at) {
                    let digits = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
                    bytes.splice(start..start + digits, word.bytes());
                }
            }
        }
    }
    bytes.truncate(1 << 16);
    bytes
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |i: usize| arguments.get(i).and_then(|a| a.parse::<u64>().ok());
    let (Some(seconds), Some(seed)) = (number(1), number(2)) else {
        eprintln!("usage: soak SECONDS SEED [TARGET...]");
        std::process::exit(2);
    };
    let mut findings = 0;
    for (name, target) in TARGETS {
        if arguments.len() > 3 && !arguments[3..].iter().any(|a| a == name) {
            continue;
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
        let seeds: Vec<Vec<u8>> = std::fs::read_dir(folder)
            .map(|files| files.filter_map(|f| std::fs::read(f.ok()?.path()).ok()).collect())
            .unwrap_or_default();
        let numeric = seeds.iter().all(|s| s.len() < 100) && !seeds.iter().any(|s| s.starts_with(b"{"));
        let (mut random, mut executions) = (Random(seed), 0_u64);
        let end = Instant::now() + Duration::from_secs(seconds);
        while Instant::now() < end {
            let bytes = if numeric && random.below(2) == 0 {
                (0..80).map(|_| random.next() as u8).collect()
            } else {
                mutated(&seeds, &mut random)
            };
            executions += 1;
            if catch_unwind(|| target(&bytes)).is_err() {
                let file = format!("soak-{name}-{seed}-{executions}.bin");
                let _ = std::fs::write(&file, &bytes);
                eprintln!("{name}: a property fails for {file}");
                findings += 1;
                if findings > 20 {
                    std::process::exit(1);
                }
            }
        }
        println!("{name}: {executions} executions in {seconds} s, seed {seed}");
    }
    std::process::exit(i32::from(findings > 0));
}
