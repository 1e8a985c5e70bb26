//! Lenses and their files: one program, so that it is linked once.

mod codev;
mod compound;
mod diffractive;
mod files;
mod formats;
mod lens_files;
mod misaligned;
mod off_axis;
mod packets;
mod patents;
mod tilt;
mod truths;
