//! Which of the instruction sets that code in lanes is compiled for this processor has.

use fearless_simd::Level;
use std::sync::OnceLock;

/// The widest one, asked of the processor once.
#[inline]
pub fn widest() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(Level::new)
}
