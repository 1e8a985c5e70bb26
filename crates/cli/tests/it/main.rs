//! The command line: one program, so that it is linked once. Deadlocks are looked for in one of its own, `threads.rs`.

mod calculators;
mod calibration;
mod cli;
mod common;
mod datasets;
mod lens_design;
mod measure;
mod rigs;
mod sheets;
mod stray;
mod why;
