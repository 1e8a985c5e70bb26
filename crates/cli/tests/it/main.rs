//! The command line: one program, so that it is linked once.

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
mod threads;
mod why;
