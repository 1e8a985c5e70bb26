//! The camera of diopter: joins the stages.
//!
//! [`Camera`] = lens + film + place; [`Shutter`] says when which part of the film is open; [`expose()`] turns a scene into a focal plane;
//! [`metering`] reads the light and [`program`] chooses by it; [`shot`] is a photograph as a user asks for it. This is the only crate that knows all stages; `mount` takes rays from
//! lens space (mm) to world space (m).
//!
//! Not here: how light is scattered (`diopter-scene`), bent (`diopter-lens`), read out (`diopter-sensor`) or developed (`diopter-develop`); arguments and messages of programs
//! (`diopter-cli`). Begin with [`shot::Shot::prepare`] for a photograph as the command line takes it, with [`expose()`] for a film of one's own.

pub mod calibration;
pub mod camera;
pub mod camera_motion;
pub mod checkpoint;
pub mod dataset;
pub mod denoising;
pub mod depth_of_field;
pub mod event_file;
pub mod events;
pub mod expose;
pub mod files;
pub mod flash;
pub mod focus;
pub mod from_light;
pub mod hdr;
pub mod iso;
pub mod lens_profile;
pub mod lesson;
pub mod measure;
pub mod memory;
pub mod metering;
mod mount;
pub mod moving_part;
mod npy;
pub mod polarizer;
pub mod program;
mod projection;
pub mod quantity;
pub mod quick_look;
pub mod raw_file;
pub mod recipe_file;
pub mod rig;
pub mod row_store;
pub mod shake;
pub mod sheet;
pub mod shot;
pub mod shutter;
pub mod stabiliser;
pub mod stops;
pub mod stray;
pub mod truth;
pub mod why;

pub use camera::{Camera, Film};
pub use camera_motion::CameraMotion;
pub use expose::{ExposeError, Half, Integrator, Response, Settings, expose};
pub use polarizer::{Polarizer, PolarizerKind};
pub use shutter::Shutter;
pub use stray::Stray;

// The stages, under one roof for front ends.
pub use diopter_develop as develop;
pub use diopter_image as image;
pub use diopter_lens as lens;
pub use diopter_light as light;
pub use diopter_scene as scene;
pub use diopter_sensor as sensor;
