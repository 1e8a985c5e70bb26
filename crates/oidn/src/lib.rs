//! Intel Open Image Denoise, opened at run time where it is installed: one safe type, [`Denoiser`].
//!
//! Nothing of the library is needed to build or to run without it. Only its CPU device is used, whose results do not depend on the machine's graphics
//! card. The binding follows `OpenImageDenoise/oidn.h` of version 2 (functions and enumerations have kept their form from 2.0 to 2.5); versions 1
//! have other functions and are refused. Source: Open Image Denoise documentation, <https://www.openimagedenoise.org/documentation.html>.
//!
//! Begin with [`Denoiser`]. Not here: the library itself, devices other than the CPU, training or weights of one's own, denoising without it (the crate `develop` has a filter).
//!
//! This crate is the only one of the workspace that holds `unsafe` code, all of it calls of these functions.

mod api;

use api::{Api, Device, Filter};
use std::ffi::{CStr, c_int};
use std::path::{Path, PathBuf};

/// Why the library cannot be used.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// No library of version 2 was found.
    NotFound {
        /// Every name and file that was tried, with what the system says.
        tried: Vec<(PathBuf, String)>,
    },
    /// What the library itself says.
    Device {
        /// What was done.
        what: &'static str,
        /// Its message.
        message: String,
    },
    /// An image whose length does not fit.
    Size {
        /// Which one.
        image: &'static str,
        /// Numbers it has.
        found: usize,
        /// Numbers that the size asks for.
        expected: usize,
    },
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Error::NotFound { tried } => {
                write!(f, "Open Image Denoise was not found; tried ")?;
                for (k, (path, reason)) in tried.iter().enumerate() {
                    let comma = if k == 0 { "" } else { "; " };
                    write!(f, "{comma}{} ({reason})", path.display())?;
                }
                Ok(())
            }
            Error::Device { what, message } => write!(f, "Open Image Denoise: {what}: {message}"),
            Error::Size { image, found, expected } => write!(f, "{image} image has {found} numbers: expected {expected}"),
        }
    }
}

impl std::error::Error for Error {}

/// How pixels are filtered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quality {
    /// For previews.
    Fast,
    /// Between the two.
    Balanced,
    /// For final pictures.
    High,
}

/// What is filtered, `[row][column][3]` each.
#[derive(Clone, Copy, Debug)]
pub struct Images<'a> {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear light, 0 or more without an upper limit.
    pub color: &'a [f32],
    /// Albedo of what is seen, 0 to 1.
    pub albedo: Option<&'a [f32]>,
    /// Normal of what is seen, -1 to 1; only together with albedo.
    pub normal: Option<&'a [f32]>,
    /// Whether albedo and normal have no noise (`cleanAux`).
    pub clean_features: bool,
}

/// The library with a device, ready to filter.
pub struct Denoiser {
    device: Device,
    version: [i32; 3],
    name: String,
    library: PathBuf,
}

/// Memory that the network may take beside the images, MB: it then works on tiles.
pub const MEMORY_MB: usize = 1024;

impl std::fmt::Debug for Denoiser {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Denoiser")
            .field("library", &self.library)
            .field("version", &self.version)
            .field("name", &self.name)
            .finish()
    }
}

impl Denoiser {
    /// Opens the first library of `candidates` that can be opened and is of version 2: files, or bare names that the system looks up. The device uses
    /// `threads` threads (0: as many as the machine has). A library that opens and then fails is an error, not a reason to try the next.
    /// Fails, too, where none can be used, and says why of each.
    pub fn open(candidates: &[PathBuf], threads: usize) -> Result<Self, Error> {
        let mut tried = Vec::new();
        for path in candidates {
            match Api::open(path) {
                Ok(api) => match Self::with(api, path, threads)? {
                    denoiser if denoiser.version[0] == 2 => return Ok(denoiser),
                    other => tried.push((path.clone(), format!("version {}; expected 2", other.version()))),
                },
                Err(api::OpenError::Library(reason)) => tried.push((path.clone(), reason)),
                Err(api::OpenError::Function(name)) => {
                    tried.push((path.clone(), format!("no function {name}: version 2 has it")))
                }
            }
        }
        Err(Error::NotFound { tried })
    }

    fn with(api: Api, path: &Path, threads: usize) -> Result<Self, Error> {
        let name = api.cpu_name().unwrap_or_else(|| "CPU".into());
        let device = Device::cpu(api).map_err(|message| Error::Device { what: "no CPU device", message })?;
        device.set_int(c"numThreads", c_int::try_from(threads).unwrap_or(0));
        // Pinned threads would stay on their cores for all later work of the program.
        device.set_bool(c"setAffinity", false);
        device.commit().map_err(|message| Error::Device { what: "the device cannot be prepared", message })?;
        let version = [c"versionMajor", c"versionMinor", c"versionPatch"].map(|part| device.get_int(part));
        Ok(Denoiser { device, version, name, library: path.to_owned() })
    }

    /// Version of the library: "2.5.1".
    pub fn version(&self) -> String {
        let [major, minor, patch] = self.version;
        format!("{major}.{minor}.{patch}")
    }

    /// What it runs on, as the library names it.
    pub fn device_name(&self) -> &str {
        &self.name
    }

    /// The file or name that was opened.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// Filters an image (`RT` filter, HDR); `out` is `[row][column][3]`. Fails on an image of another size, and with the library's reason where the
    /// filter cannot be made or run.
    pub fn denoise(&self, images: &Images, quality: Quality, out: &mut [f32]) -> Result<(), Error> {
        let expected = images.width.saturating_mul(images.height).saturating_mul(3);
        let given =
            [("color", Some(images.color)), ("albedo", images.albedo), ("normal", images.normal), ("output", Some(&*out))];
        for (image, data) in given {
            if let Some(data) = data
                && data.len() != expected
            {
                return Err(Error::Size { image, found: data.len(), expected });
            }
        }
        if expected == 0 {
            return Ok(());
        }
        let fails = |what: &'static str| move |message: String| Error::Device { what, message };
        let mut filter = Filter::ray_traced(&self.device).map_err(fails("no filter"))?;
        let size = [images.width, images.height];
        let inputs: [(&CStr, Option<&[f32]>); 3] = [
            (c"color", Some(images.color)),
            (c"albedo", images.albedo),
            // The library takes normals only together with albedo.
            (c"normal", images.normal.filter(|_| images.albedo.is_some())),
        ];
        for (name, data) in inputs {
            if let Some(data) = data {
                filter.set_input(name, data, size);
            }
        }
        filter.set_output(out, size);
        filter.set_bool(c"hdr", true);
        filter.set_bool(c"cleanAux", images.clean_features && images.albedo.is_some());
        filter.set_int(c"maxMemoryMB", c_int::try_from(MEMORY_MB).unwrap_or(c_int::MAX));
        filter.set_int(
            c"quality",
            match quality {
                Quality::Fast => 4,
                Quality::Balanced => 5,
                Quality::High => 6,
            },
        );
        filter.commit().map_err(fails("the filter cannot be prepared"))?;
        filter.execute().map_err(fails("filtering failed"))
    }
}

/// Bare names under which this system's own search finds the library.
pub fn system_names() -> Vec<PathBuf> {
    let names: &[&str] = if cfg!(windows) {
        &["OpenImageDenoise.dll"]
    } else if cfg!(target_os = "macos") {
        &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib", "/opt/homebrew/lib/libOpenImageDenoise.dylib"]
    } else {
        &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
    };
    names.iter().map(PathBuf::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_that_is_missing_is_an_error_that_names_what_was_tried() {
        let error = Denoiser::open(&[PathBuf::from("/nowhere/libOpenImageDenoise.so")], 1).unwrap_err();
        assert!(matches!(&error, Error::NotFound { tried } if tried.len() == 1));
        assert!(error.to_string().contains("/nowhere/libOpenImageDenoise.so"), "{error}");
    }

    #[test]
    fn another_library_is_refused_by_the_function_it_lacks() {
        let error = Denoiser::open(&[PathBuf::from("libc.so.6")], 1).unwrap_err().to_string();
        // The C library is there on Linux; elsewhere there is nothing to open.
        assert!(!cfg!(all(target_os = "linux", target_env = "gnu")) || error.contains("no function oidn"), "{error}");
    }

    /// Runs where the library is installed: set `DIOPTER_OIDN` to its file.
    #[test]
    fn an_installed_library_filters_and_checks_sizes() {
        let own = std::env::var_os("DIOPTER_OIDN").map(PathBuf::from);
        let candidates: Vec<PathBuf> = own.into_iter().chain(system_names()).collect();
        let denoiser = match Denoiser::open(&candidates, 1) {
            Ok(denoiser) => denoiser,
            // Who names a library wants it tested.
            Err(e) if std::env::var_os("DIOPTER_OIDN").is_some() => panic!("{e}"),
            Err(_) => return println!("no Open Image Denoise here: nothing was tested"),
        };
        assert!(denoiser.version().starts_with("2."), "{}", denoiser.version());
        assert!(!denoiser.device_name().is_empty());
        let size = [48, 32];
        // Grey with a checkerboard of a tenth of noise.
        let color: Vec<f32> =
            (0..size[0] * size[1]).flat_map(|i| [0.5 + if (i % 48 + i / 48) % 2 == 0 { 0.05 } else { -0.05 }; 3]).collect();
        let mut out = vec![0.0; color.len()];
        let images = Images { width: size[0], height: size[1], color: &color, albedo: None, normal: None, clean_features: false };
        denoiser.denoise(&images, Quality::High, &mut out).unwrap();
        assert!(out.iter().all(|v| (v - 0.5).abs() < 0.1));
        let short = Images { albedo: Some(&color[..3]), ..images };
        let error = denoiser.denoise(&short, Quality::High, &mut out).unwrap_err();
        assert!(error.to_string().contains("albedo"), "{error}");
        let empty = Images { width: 0, height: 0, color: &[], ..images };
        denoiser.denoise(&empty, Quality::High, &mut []).unwrap();
    }
}
