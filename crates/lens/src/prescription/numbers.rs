//! Numbers as lens sheets write them.

/// A number that TOML reads back as the same.
pub(super) fn number(v: f64) -> String {
    if v != 0.0 && !(1e-4..1e15).contains(&v.abs()) { format!("{v:e}") } else { format!("{v}") }
}

/// Numbers in brackets.
pub(super) fn list(v: &[f64]) -> String {
    format!("[{}]", v.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", "))
}
