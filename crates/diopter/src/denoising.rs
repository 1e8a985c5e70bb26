//! Which filter takes the renderer's own noise out of an exposure: Intel Open Image Denoise where it is installed, else our own
//! ([`mod@diopter_develop::denoise`]).
//!
//! Either works on the electrons (or radiance) of the bands before the sensor sees them; the sensor's noise is made later, by the light that is then
//! there, and is not touched. What a filter takes from the light of a place is given back around it ([`diopter_develop::denoise::keep_light`]).

use crate::shot::error::ShotError;
use diopter_develop::denoise::{self as built_in, Denoised, keep_light, without_specks};
use diopter_image::focal_plane::{FocalPlaneSource, Truth};
use diopter_image::{FocalPlane, ImageError, Raster};
use diopter_oidn::{Denoiser, Images, Quality};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Environment variable with the file or folder of the library.
pub const LIBRARY_VARIABLE: &str = "DIOPTER_OIDN";
/// What facts call the built-in filter.
pub const BUILT_IN: &str = "built-in regression";

/// Whether the renderer's noise is reduced, and by what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "Written")]
#[non_exhaustive]
pub enum Denoise {
    /// On in developed pictures (JPEG, PNG, TIFF) of `shoot`, off in raw files, EXR and exposures.
    #[default]
    Auto,
    /// On in everything, by the best filter that is installed.
    On,
    /// Off.
    Off,
    /// On in everything, by Open Image Denoise, which must be there.
    Oidn,
    /// On in everything, by the built-in regression.
    BuiltIn,
}

impl Denoise {
    /// Names as they are written.
    pub const NAMES: [(&'static str, Denoise); 5] = [
        ("auto", Denoise::Auto),
        ("on", Denoise::On),
        ("off", Denoise::Off),
        ("oidn", Denoise::Oidn),
        ("builtin", Denoise::BuiltIn),
    ];
}

impl std::fmt::Display for Denoise {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(Denoise::NAMES.iter().find(|n| n.1 == *self).map_or("auto", |n| n.0))
    }
}

impl From<Denoise> for String {
    fn from(denoise: Denoise) -> String {
        denoise.to_string()
    }
}

impl std::str::FromStr for Denoise {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        Denoise::NAMES
            .iter()
            .find(|n| n.0 == text)
            .map(|n| n.1)
            .ok_or_else(|| format!("\"{text}\" is none of auto, on, off, oidn and builtin (before a file write --denoise on)"))
    }
}

/// As shot files write it: a name, or true and false.
#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Switch(bool),
    Name(String),
}

impl TryFrom<Written> for Denoise {
    type Error = String;
    fn try_from(written: Written) -> Result<Self, String> {
        match written {
            Written::Switch(true) => Ok(Denoise::On),
            Written::Switch(false) => Ok(Denoise::Off),
            Written::Name(name) => name.parse(),
        }
    }
}

/// A filter ready for use.
#[derive(Debug)]
#[non_exhaustive]
pub enum Filter {
    /// Nonlinearly weighted first-order regression, [`mod@diopter_develop::denoise`].
    BuiltIn,
    /// Open Image Denoise.
    Oidn(Box<Denoiser>),
}

impl Filter {
    /// Opens the filter that is asked for; `None` for [`Denoise::Off`]. `library`: file or folder of Open Image Denoise; without one it is looked for
    /// ([`candidates`]).
    ///
    /// Fails when Open Image Denoise is asked for, by mode or by file, and cannot be used. What [`LIBRARY_VARIABLE`] names and is not there is only told
    /// to `warn`.
    pub fn open(denoise: Denoise, library: Option<&Path>, warn: &mut dyn FnMut(&str)) -> Result<Option<Filter>, ShotError> {
        match denoise {
            Denoise::Off => return Ok(None),
            Denoise::BuiltIn => return Ok(Some(Filter::BuiltIn)),
            Denoise::Auto | Denoise::On | Denoise::Oidn => (),
        }
        let variable = std::env::var_os(LIBRARY_VARIABLE).filter(|v| !v.is_empty()).map(PathBuf::from);
        let given = library.map(Path::to_owned).or_else(|| variable.clone());
        let must = denoise == Denoise::Oidn || library.is_some();
        match Denoiser::open(&candidates(given.as_deref()), rayon::current_num_threads()) {
            Ok(denoiser) => Ok(Some(Filter::Oidn(Box::new(denoiser)))),
            Err(e) if must => Err(ShotError::Denoise(format!(
                "{e}: expected its library (`pip install pyoidn` or {LIBRARY_VARIABLE}=FILE or --oidn FILE), or --denoise builtin"
            ))),
            Err(e) => {
                // A library that is there and does not work is worth a word; none at all is not.
                if variable.is_some() || !matches!(e, diopter_oidn::Error::NotFound { .. }) {
                    warn(&format!("{e}: the built-in filter is used"));
                }
                Ok(Some(Filter::BuiltIn))
            }
        }
    }

    /// How facts call it.
    pub fn name(&self) -> String {
        match self {
            Filter::BuiltIn => BUILT_IN.into(),
            Filter::Oidn(d) => format!("Open Image Denoise {} ({})", d.version(), d.device_name()),
        }
    }

    /// An exposure without most of the renderer's noise. `features`: what albedo and normals are to be taken from instead of its truth. Fails where Open Image Denoise
    /// reports an error.
    pub fn denoise(&self, plane: &FocalPlane, features: Option<&Truth>) -> Result<FocalPlane, ShotError> {
        let shown = features.map(|f| FocalPlane { truth: f.clone(), ..plane.clone() });
        let seen = shown.as_ref().unwrap_or(plane);
        let failed = |reason: String| ShotError::Denoise(reason);
        let mut out = match self {
            Filter::BuiltIn => by_strips(seen).map_err(|e| failed(e.to_string()))?,
            Filter::Oidn(d) => through_library(d, seen).map_err(|e| failed(e.to_string()))?,
        };
        if features.is_some() {
            out.truth.clone_from(&plane.truth);
        }
        out.facts.denoised = true;
        out.facts.denoiser = self.name();
        Ok(out)
    }

    /// [`Filter::denoise`] without features, of all rows at once; given up within milliseconds once `cancel` is set: `None` then. Open Image Denoise cannot be
    /// stopped, and takes less time. Fails as [`Filter::denoise`].
    pub fn denoise_unless(&self, plane: &FocalPlane, cancel: &AtomicBool) -> Result<Option<FocalPlane>, ShotError> {
        if cancel.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let Filter::BuiltIn = self else { return self.denoise(plane, None).map(Some) };
        Ok(built_in::denoise_unless(plane, cancel).map(|mut out| {
            out.facts.denoiser = self.name();
            out
        }))
    }

    /// [`Filter::denoise`] without features, for small pictures that are looked at for a moment: the built-in filter by fewer neighbours, in a third of the time. Fails
    /// as it does.
    pub fn denoise_coarsely(&self, plane: &FocalPlane) -> Result<FocalPlane, ShotError> {
        let Filter::BuiltIn = self else { return self.denoise(plane, None) };
        let mut out = built_in::denoise_coarsely(plane);
        out.facts.denoiser = self.name();
        Ok(out)
    }

    /// Ways to filter an exposure, of which the one with less memory is taken: bytes a pixel, the exposure included, and all others.
    pub fn bytes(&self, bands: usize) -> Vec<(usize, usize)> {
        let planes = 2 * diopter_image::focal_plane::bytes_a_pixel(bands);
        match self {
            Filter::BuiltIn => vec![(built_in::bytes_a_pixel(bands), 0), (planes, built_in::STRIP_MEMORY)],
            // Images of three numbers: albedo, normal, a colour and a result, and all of them in half the size; sums of light. What the network takes itself is bounded by the library,
            // which works on tiles.
            // The exposure, its features, the exposure with them and the result are there at once.
            Filter::Oidn(_) => vec![(2 * planes + 4 * 3 * 6 + 4 * 4, LIBRARY_MEMORY)],
        }
    }
}

/// What the network takes at most beside the images, bytes: it works on tiles within so much.
const LIBRARY_MEMORY: usize = diopter_oidn::MEMORY_MB << 20;

/// Where Open Image Denoise may be, in the order in which it is tried: `given` alone, if it is; else what lies beside this program, what the system
/// finds by name, and what Python environments hold (package `pyoidn`).
pub fn candidates(given: Option<&Path>) -> Vec<PathBuf> {
    let names = diopter_oidn::system_names();
    let in_folder = |folder: &Path| {
        let names = names.iter().filter(|n| n.components().count() == 1);
        names.map(|name| folder.join(name)).collect::<Vec<_>>()
    };
    if let Some(path) = given {
        return if path.is_dir() { in_folder(path) } else { vec![path.to_owned()] };
    }
    let beside = std::env::current_exe().ok().and_then(|exe| exe.parent().map(Path::to_owned));
    let folders = beside.iter().flat_map(|bin| [bin.clone(), bin.join("../lib"), bin.join("oidn/lib")]);
    let files = |folders: Vec<PathBuf>| folders.iter().flat_map(|f| in_folder(f)).filter(|f| f.is_file()).collect::<Vec<_>>();
    let mut all = files(folders.collect());
    all.extend(names.iter().cloned());
    let inside = |site: PathBuf| site.join("pyoidn/oidn").join(if cfg!(windows) { "bin" } else { "lib" });
    all.extend(files(site_packages().into_iter().map(inside).collect()));
    all
}

/// Folders of the packages of Python environments: the one that is active, those of interpreters on the path, the user's.
fn site_packages() -> Vec<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let mut roots: Vec<PathBuf> = ["VIRTUAL_ENV", "CONDA_PREFIX"].iter().filter_map(|v| variable(v)).collect();
    // An interpreter lies in `bin` of its environment (links followed: a link points into it), on Windows beside `Lib`.
    for folder in std::env::var_os("PATH").iter().flat_map(std::env::split_paths) {
        // What lies in the working folder is not opened unasked.
        if !folder.is_absolute() {
            continue;
        }
        let python = folder.join(if cfg!(windows) { "python.exe" } else { "python3" });
        let Ok(real) = python.canonicalize() else { continue };
        roots.extend(
            [python, real].iter().filter_map(|p| p.parent()).map(|bin| if cfg!(windows) { bin.into() } else { bin.join("..") }),
        );
    }
    let home = variable(if cfg!(windows) { "USERPROFILE" } else { "HOME" });
    roots.extend(home.iter().map(|home| home.join(".local")));
    // Its interpreters are on the path as scripts only.
    let pyenv = variable("PYENV_ROOT").or_else(|| home.map(|h| h.join(".pyenv")));
    roots.extend(pyenv.iter().flat_map(|root| entries(&root.join("versions"))));
    let mut found = Vec::new();
    for root in roots {
        let versions = entries(&root.join("lib"))
            .into_iter()
            .filter(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with("python3")));
        let of_version = versions.flat_map(|v| [v.join("site-packages"), v.join("dist-packages")]);
        for site in of_version.chain([root.join("Lib/site-packages")]) {
            if site.is_dir() && !found.contains(&site) {
                found.push(site);
            }
        }
    }
    found
}

/// What is in a folder, by name; nothing if it cannot be read.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    all.sort();
    all
}

/// The built-in filter: of the whole at once where that takes little memory, else strip by strip with the same result.
fn by_strips(plane: &FocalPlane) -> Result<FocalPlane, ImageError> {
    let ([width, height], bands) = ([plane.width(), plane.height()], plane.bands.len());
    let rows = built_in::rows_at_once(width, bands, plane.truth.recorded().more_bytes());
    if width * height == 0 || rows >= height {
        return Ok(built_in::denoise(plane));
    }
    let farthest = built_in::farthest_log_depth_of(&plane.truth.depth().data);
    let mut strips = Denoised::new(plane.strips(), farthest).named(BUILT_IN);
    // Every row is replaced.
    let empty = || Raster { width, height: 0, channels: bands, data: Vec::with_capacity(width * height * bands) };
    let (mut mean, mut half_difference) = (empty(), empty());
    for first in (0..height).step_by(rows) {
        let strip = strips.next_rows(rows.min(height - first))?;
        mean.append(&strip.mean)?;
        half_difference.append(&strip.half_difference)?;
    }
    let facts = strips.facts().clone();
    Ok(FocalPlane { bands: plane.bands.clone(), mean, half_difference, truth: plane.truth.clone(), facts })
}

/// The mean through the network, and what noise is left by half the difference of the two halves of the samples, which go through it in half the size
/// and in its fast kind: errors that are left are wider than a pixel, and this costs a third of filtering itself instead of twice as much.
///
/// Three bands are filtered together as one colour picture, other numbers of bands each as a grey one.
fn through_library(library: &Denoiser, plane: &FocalPlane) -> Result<FocalPlane, diopter_oidn::Error> {
    let (width, height, n) = (plane.width(), plane.height(), plane.bands.len());
    let mut out = plane.clone();
    if width * height == 0 || n == 0 {
        return Ok(out);
    }
    let within = |raster: &Raster<f32>, low: f32| Raster {
        data: raster.data.iter().map(|v| finite(*v).clamp(low, 1.0)).collect(),
        ..*raster
    };
    let features = [within(plane.truth.albedo(), 0.0), within(plane.truth.normal(), -1.0)];
    let small_features = [halved(&features[0]), halved(&features[1])];
    let together = if n == 3 { 3 } else { 1 };
    for first in (0..n).step_by(together) {
        // Which band each of the three channels shows.
        let bands: [usize; 3] = if together == 3 { [0, 1, 2] } else { [first; 3] };
        let Some(scales) = scales(plane, bands) else { continue };
        // The mean, and the mean with its half difference added or subtracted.
        let color = |sign: f32| -> Raster<f32> {
            let value = |pixel: usize, c: usize| {
                let k = pixel * n + bands[c];
                ((finite(plane.mean.data[k]) + sign * finite(plane.half_difference.data[k])) / scales[c]).max(0.0)
            };
            let data = (0..width * height).flat_map(|i| [value(i, 0), value(i, 1), value(i, 2)]).collect();
            Raster { width, height, channels: 3, data }
        };
        let mean = filtered(library, &color(0.0), &features, Quality::High)?;
        let [a, b] = [1.0, -1.0].map(|sign| filtered(library, &halved(&color(sign)), &small_features, Quality::Fast));
        let (a, b) = (a?, b?);
        let light = mean.iter().enumerate().map(|(i, v)| finite(*v).max(0.0) * scales[i % 3]).collect();
        let mut light = Raster { width, height, channels: 3, data: light };
        let factors = without_specks(&light, plane.truth.albedo());
        light.data.iter_mut().zip(factors).for_each(|(v, f)| *v *= f);
        for c in 0..together {
            let before: Vec<f32> = plane.mean.data.iter().skip(bands[c]).step_by(n).map(|v| finite(*v)).collect();
            let after = light.channel(c);
            for (i, factor) in keep_light(&before, &after, width).into_iter().enumerate() {
                let k = i * n + bands[c];
                let small = ((i / width / 2) * width.div_ceil(2) + i % width / 2) * 3 + c;
                out.mean.data[k] = factor * after[i];
                out.half_difference.data[k] = factor * 0.5 * finite(a[small] - b[small]) * scales[c];
            }
        }
    }
    Ok(out)
}

/// What is no number is taken for 0.
fn finite(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

/// What bands are divided by before the network sees them, their means: it knows pictures in which white is white. (How bright they are as a whole is its
/// own matter, `inputScale`.) `None` where all are dark.
fn scales(plane: &FocalPlane, bands: [usize; 3]) -> Option<[f32; 3]> {
    let n = plane.bands.len();
    let mean_of = |b: usize| {
        let sum: f64 = plane.mean.data.iter().skip(b).step_by(n).map(|v| f64::from(finite(*v))).sum();
        (sum / (plane.width() * plane.height()) as f64) as f32
    };
    let scales = bands.map(mean_of);
    let bright = |s: f32| s > 0.0 && s.is_finite();
    scales.iter().any(|s| bright(*s)).then(|| scales.map(|s| if bright(s) { s } else { 1.0 }))
}

/// A picture through the network, `[row][column][3]`; `features`: albedo and normals. They are free of noise, but not told to be (`cleanAux`): that
/// network takes 2.3 times as long, and where lenses blur what the features show sharply it is not better.
fn filtered(
    library: &Denoiser,
    color: &Raster<f32>,
    [albedo, normal]: &[Raster<f32>; 2],
    quality: Quality,
) -> Result<Vec<f32>, diopter_oidn::Error> {
    let mut out = vec![0.0; color.data.len()];
    let images = Images {
        width: color.width,
        height: color.height,
        color: &color.data,
        albedo: Some(&albedo.data),
        normal: Some(&normal.data),
        clean_features: false,
    };
    library.denoise(&images, quality, &mut out)?;
    Ok(out)
}

/// A picture of three channels in half the size: means over 2 × 2 pixels, fewer at edges of odd length.
fn halved(picture: &Raster<f32>) -> Raster<f32> {
    let (width, height) = (picture.width.div_ceil(2), picture.height.div_ceil(2));
    let mut out = Raster::new(width, height, 3);
    for y in 0..height {
        for x in 0..width {
            let rows = 2 * y..(2 * y + 2).min(picture.height);
            let columns = 2 * x..(2 * x + 2).min(picture.width);
            let count = (rows.len() * columns.len()) as f32;
            let to = out.pixel_mut(x, y);
            for row in rows {
                for column in columns.clone() {
                    to.iter_mut().zip(picture.pixel(column, row)).for_each(|(t, v)| *t += v / count);
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::ExposureFacts;
    use diopter_image::focal_plane::{Band, BandUnit};

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Section {
        denoise: Denoise,
    }

    #[test]
    fn modes_are_names_or_switches() {
        let read = |text: &str| toml::from_str::<Section>(text).map(|s| s.denoise);
        assert_eq!(read("denoise = true").unwrap(), Denoise::On);
        assert_eq!(read("denoise = false").unwrap(), Denoise::Off);
        for (name, mode) in Denoise::NAMES {
            assert_eq!(read(&format!("denoise = \"{name}\"")).unwrap(), mode);
            assert_eq!(toml::to_string(&Section { denoise: mode }).unwrap().trim(), format!("denoise = \"{name}\""));
        }
        assert!(read("denoise = \"maybe\"").is_err() && "On".parse::<Denoise>().is_err());
    }

    #[test]
    fn a_library_that_is_asked_for_must_be_there() {
        let nowhere = Path::new("/nowhere/libOpenImageDenoise.so.2");
        let mut warn = |_: &str| ();
        for mode in [Denoise::Oidn, Denoise::On, Denoise::Auto] {
            let error = Filter::open(mode, Some(nowhere), &mut warn).unwrap_err().to_string();
            assert!(error.contains("/nowhere/") && error.contains("builtin"), "{error}");
        }
        assert!(matches!(Filter::open(Denoise::BuiltIn, Some(nowhere), &mut warn), Ok(Some(Filter::BuiltIn))));
        assert!(matches!(Filter::open(Denoise::Off, Some(nowhere), &mut warn), Ok(None)));
    }

    #[test]
    fn a_folder_is_searched_for_the_library_and_a_file_is_taken_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        assert!(candidates(Some(folder.path())).iter().all(|c| c.starts_with(folder.path())));
        let file = folder.path().join("mine.so");
        assert_eq!(candidates(Some(&file)), [file]);
        assert!(candidates(None).len() >= diopter_oidn::system_names().len());
    }

    /// Noise of a fifth around 100 electrons in a number of bands; the last one dark.
    fn noisy(bands: usize) -> FocalPlane {
        let bands: Vec<Band> = (0..bands).map(|b| Band { name: b.to_string(), unit: BandUnit::Electrons }).collect();
        let n = bands.len();
        let mut plane = FocalPlane::even(bands, &vec![100.0; n], [40, 30], ExposureFacts::default());
        let noise = |k: u32| 20.0 * 3.46 * (diopter_light::random::to_unit(diopter_light::random::mix(k)) - 0.5);
        for k in 0..plane.mean.data.len() {
            let dark = n > 1 && k % n == n - 1;
            let [a, b] = [0, 1].map(|h| if dark { 0.0 } else { 100.0 + noise(2 * k as u32 + h) });
            plane.mean.data[k] = 0.5 * (a + b);
            plane.half_difference.data[k] = 0.5 * (a - b);
        }
        plane
    }

    #[test]
    fn a_filter_that_can_be_stopped_does_the_same() {
        let mut plane = noisy(3);
        let more = plane.clone();
        while plane.height() < 64 {
            plane.append(&more).unwrap();
        }
        plane.truth.depth_mut().data[9] = 2.5;
        let go_on = AtomicBool::new(false);
        let stoppable = Filter::BuiltIn.denoise_unless(&plane, &go_on).unwrap().unwrap();
        let whole = Filter::BuiltIn.denoise(&plane, None).unwrap();
        assert!(stoppable.mean == whole.mean && stoppable.half_difference == whole.half_difference);
        assert_eq!(stoppable.facts, whole.facts);
        assert!(Filter::BuiltIn.denoise_unless(&plane, &AtomicBool::new(true)).unwrap().is_none());
        // Fewer neighbours leave more of the noise, and no less light.
        let coarse = Filter::BuiltIn.denoise_coarsely(&plane).unwrap();
        assert_eq!(coarse.facts, whole.facts);
        let [before, fine, coarse] = [&plane, &whole, &coarse].map(|p| variance(&p.mean.channel(0)));
        assert!(fine < coarse && coarse < 0.5 * before, "{before} {fine} {coarse}");
    }

    fn variance(values: &[f32]) -> f32 {
        values.iter().map(|v| (v - 100.0).powi(2)).sum::<f32>() / values.len() as f32
    }

    fn takes_noise_and_keeps_light(filter: &Filter, most_left: f32) {
        for bands in [1, 3, 5] {
            let mut plane = noisy(bands);
            plane.truth.normal_mut().data[7] = f32::NAN;
            plane.truth.albedo_mut().data[8] = f32::INFINITY;
            let out = filter.denoise(&plane, None).unwrap();
            assert!(out.facts.denoised && out.facts.denoiser == filter.name());
            assert_eq!(out.truth.id(), plane.truth.id());
            let [before, after] = [&plane, &out].map(|p| p.mean.channel(0));
            assert!(variance(&after) < most_left * variance(&before), "{bands}: {} of {}", variance(&after), variance(&before));
            let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
            assert!((sum(&after) / sum(&before) - 1.0).abs() < 3e-3, "{bands}: {}", sum(&after) / sum(&before));
            if bands > 1 {
                // A network may leave a trace of the colours beside it.
                assert!(out.mean.channel(bands - 1).iter().all(|v| v.abs() < 0.5));
            }
            // What is left says of itself that it is small.
            let left = out.half_difference.channel(0).iter().map(|d| d * d).sum::<f32>() / after.len() as f32;
            assert!(left < 0.2 * variance(&before), "{left}");
        }
    }

    #[test]
    fn the_built_in_filter_takes_noise_and_keeps_light() {
        // An even field: a window of hundreds of pixels averages it; a tenth of the variance is far from that limit.
        takes_noise_and_keeps_light(&Filter::BuiltIn, 0.1);
    }

    /// Runs where the library is installed.
    #[test]
    fn the_library_takes_noise_and_keeps_light() {
        if let Ok(Some(filter @ Filter::Oidn(_))) = Filter::open(Denoise::On, None, &mut |_| ()) {
            // The network takes a part of even noise for texture.
            takes_noise_and_keeps_light(&filter, 0.5);
        }
    }
}
