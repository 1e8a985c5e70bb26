//! Files to write: proved writable before the work, written beside, renamed when whole. Pipes and devices are written when all is known.

use crate::UsageError;
use crate::parts::{cut, forget_part, machine, note_part, part_name, remove_orphans};
use crate::watch::warn;
use anyhow::{Context, anyhow};
use diopter::develop::lut::Lut;
use diopter::develop::{Developer, Recipe};
use diopter::files;
use diopter::image::dng::Storage;
use diopter::image::focal_plane::FocalPlaneSource;
use diopter::image::truth::Recorded;
use diopter::image::{Encoding, FocalPlane, ImageError, Picture, RawImage, exr, gain_map, jpeg, png, tiff_file};
use diopter::raw_file;
use diopter::shot::ShotError;
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// JPEG quality: high, because the pictures are looked at.
pub const JPEG_QUALITY: u8 = 92;

/// A file that is going to be written. Dropped without [`Output::commit`], it leaves no trace.
pub struct Output {
    /// As it was given.
    path: PathBuf,
    part: PathBuf,
    target: Target,
    file: Option<File>,
}

/// What becomes of a part once it is whole.
enum Target {
    /// It is renamed to this: the file that was named, or what symbolic links make of it.
    File(PathBuf),
    /// It is copied into a pipe or a device, which can neither be renamed nor, as some formats need, be sought in.
    Stream(File),
}

/// What a file's ending says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Jpeg,
    Png,
    Tiff,
    Exr,
    Dng,
}

impl Kind {
    /// Whether files of this kind are pictures to look at, rather than light or electrons to work on.
    pub fn is_looked_at(self) -> bool {
        match self {
            Kind::Jpeg | Kind::Png | Kind::Tiff => true,
            Kind::Exr | Kind::Dng => false,
        }
    }
}

/// Kind of a picture file by its ending. Fails on one that is not known; a pipe or device without an ending gets a JPEG.
pub fn kind(path: &Path) -> anyhow::Result<Kind> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("jpg" | "jpeg") => Ok(Kind::Jpeg),
        Some("png") => Ok(Kind::Png),
        Some("tif" | "tiff") => Ok(Kind::Tiff),
        Some("exr") => Ok(Kind::Exr),
        Some("dng") => Ok(Kind::Dng),
        // `-o /dev/stdout`: what cameras write by default.
        None if is_stream(path) => Ok(Kind::Jpeg),
        _ => Err(UsageError(anyhow!("{}: expected a name that ends in .jpg, .png, .tif, .exr or .dng", path.display())).into()),
    }
}

/// The same of a developed picture: no raw file.
pub fn kind_of_developed(path: &Path) -> anyhow::Result<Kind> {
    match kind(path) {
        Ok(kind) if kind != Kind::Dng => Ok(kind),
        _ => Err(UsageError(anyhow!(
            "{}: expected a name that ends in .jpg, .png, .tif or .exr, as a developed picture's does",
            path.display()
        ))
        .into()),
    }
}

impl Output {
    /// Opens the file beside; fails now if it cannot be written. A name that is a symbolic link stands for what it points to, which need not be there
    /// yet. A named pipe waits for its reader here.
    pub fn prepare(path: &Path) -> anyhow::Result<Self> {
        let place = || format!("{}: cannot be written", path.display());
        let name = path.file_name().ok_or_else(|| UsageError(anyhow!("{}: expected the name of a file", path.display())))?;
        let told = std::fs::metadata(path);
        if told.as_ref().is_ok_and(|m| m.is_dir()) {
            return Err(UsageError(anyhow!("{}: this is a folder; expected the name of a file", path.display())).into());
        }
        // Links in a circle, folders that may not be entered.
        if let Err(e) = told
            && e.kind() != io::ErrorKind::NotFound
        {
            return Err(files::in_words(path, e)).with_context(place);
        }
        let name = name.to_string_lossy();
        let (part, target, file) = if is_stream(path) {
            let stream = open_stream(path).with_context(place)?;
            let folder = std::env::temp_dir();
            remove_orphans(&folder);
            // Streams of one name may lie in several folders; a temporary folder is everybody's: only a new file is ours.
            static STREAMS: AtomicUsize = AtomicUsize::new(0);
            let name = format!("diopter-{}-{}", STREAMS.fetch_add(1, Ordering::Relaxed), cut(&name));
            let part = folder.join(part_name(&name, machine(), std::process::id()));
            let file = OpenOptions::new().write(true).create_new(true).open(&part);
            let file = file.with_context(|| format!("{}: the temporary file {}", path.display(), part.display()))?;
            (part, Target::Stream(stream), file)
        } else {
            let target = links(path).pop().unwrap_or_else(|| path.to_owned());
            let name = target.file_name().unwrap_or_default().to_string_lossy();
            let part = target.with_file_name(part_name(&name, machine(), std::process::id()));
            remove_orphans(target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")));
            let file = File::create(&part).map_err(|e| files::in_words(&target, e)).with_context(|| match target == path {
                true => place(),
                false => format!("{} (a link to {}): cannot be written", path.display(), target.display()),
            })?;
            (part, Target::File(target), file)
        };
        note_part(part.clone());
        Ok(Output { path: path.to_owned(), part, target, file: Some(file) })
    }

    /// Writes the file by a function and gives it its name, or passes it on to its pipe or device.
    pub fn commit(mut self, write: impl FnOnce(&mut BufWriter<File>) -> anyhow::Result<()>) -> anyhow::Result<PathBuf> {
        let file = self.file.take().expect("an output is committed once");
        let mut writer = BufWriter::new(file);
        let place = || format!("{}: cannot be written", self.path.display());
        write(&mut writer).with_context(place)?;
        writer.flush().with_context(place)?;
        drop(writer);
        if self.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) {
            // The same picture is the same bytes.
            let mut file = OpenOptions::new().read(true).write(true).open(&self.part).with_context(place)?;
            exr::sort_attributes_in(&mut file).with_context(place)?;
        }
        match &mut self.target {
            Target::File(target) => std::fs::rename(&self.part, target).with_context(place)?,
            Target::Stream(stream) => {
                let mut whole = File::open(&self.part).with_context(place)?;
                io::copy(&mut whole, stream).with_context(place)?;
            }
        }
        Ok(self.path.clone())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        self.file = None;
        forget_part(&self.part);
        // Renamed files are no longer there; nothing can be done about one that cannot be removed.
        let _ = std::fs::remove_file(&self.part);
    }
}

/// A name, and what symbolic links make of it, one after another.
fn links(path: &Path) -> Vec<PathBuf> {
    /// As many as Linux follows (path_resolution(7)).
    const MOST: usize = 40;
    let to = |from: &PathBuf| Some(from.parent()?.join(std::fs::read_link(from).ok()?));
    std::iter::successors(Some(path.to_owned()), to).take(MOST + 1).collect()
}

/// Standard output and standard error by their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standard {
    Output,
    Error,
}

impl Standard {
    fn named(path: &Path) -> Option<Self> {
        const NAMES: [(&str, Standard); 6] = [
            ("/dev/stdout", Standard::Output),
            ("/dev/fd/1", Standard::Output),
            ("/proc/self/fd/1", Standard::Output),
            ("/dev/stderr", Standard::Error),
            ("/dev/fd/2", Standard::Error),
            ("/proc/self/fd/2", Standard::Error),
        ];
        links(path).iter().find_map(|p| NAMES.iter().find(|n| Path::new(n.0) == p).map(|n| n.1))
    }
}

/// Whether a name is that of a pipe or a device, or of standard output: there is nothing to rename, and nothing to write beside.
pub fn is_stream(path: &Path) -> bool {
    Standard::named(path).is_some() || std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// Opens a pipe or a device. Standard output goes on where it is: opened anew, a file behind it would be written from its beginning.
#[cfg(unix)]
fn open_stream(path: &Path) -> io::Result<File> {
    use std::os::fd::AsFd;
    match Standard::named(path) {
        Some(Standard::Output) => Ok(io::stdout().as_fd().try_clone_to_owned()?.into()),
        Some(Standard::Error) => Ok(io::stderr().as_fd().try_clone_to_owned()?.into()),
        None => OpenOptions::new().write(true).open(path),
    }
}

#[cfg(not(unix))]
fn open_stream(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).open(path)
}

/// Whether it takes any number of files and keeps none: `/dev/null`.
#[cfg(unix)]
fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|m| m.file_type().is_char_device())
}

#[cfg(not(unix))]
fn is_device(_: &Path) -> bool {
    false
}

/// Names of several files from one: a number before the ending.
pub fn numbered(path: &Path, count: usize) -> Vec<PathBuf> {
    if count == 1 {
        return vec![path.to_owned()];
    }
    let digits = count.to_string().len().max(3);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    (1..=count).map(|k| path.with_file_name(format!("{stem}-{k:0digits$}{ending}"))).collect()
}

/// A path once for each suffix: `photo-left.dng`, `photo-right.dng`.
pub fn with_suffixes(path: &Path, suffixes: &[&str]) -> Vec<PathBuf> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    suffixes.iter().map(|suffix| path.with_file_name(format!("{stem}-{suffix}{ending}"))).collect()
}

/// Refuses to write one file twice, or over a file that is read.
pub fn distinct<'a>(
    inputs: impl IntoIterator<Item = &'a Path>,
    outputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    // The same file by any way to its folder; one that is not there yet has no other name.
    let place = |path: &Path| {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        path.canonicalize().unwrap_or_else(|_| folder.join(path.file_name().unwrap_or_default()))
    };
    let mut taken: HashMap<PathBuf, &str> =
        inputs.into_iter().map(|p| (place(p), "it is read here; expected another name")).collect();
    for path in outputs.into_iter().filter(|p| !is_device(p)) {
        if let Some(why) = taken.insert(place(path), "it is to be written twice; expected different names") {
            return Err(UsageError(anyhow!("{}: {why}", path.display())).into());
        }
    }
    Ok(())
}

/// Prepares all pictures, refusing what cannot be written before any work is done.
pub fn prepare_pictures(paths: &[PathBuf]) -> anyhow::Result<Vec<(Kind, Output)>> {
    let kinds = paths.iter().map(|p| kind(p)).collect::<anyhow::Result<Vec<_>>>()?;
    kinds.into_iter().zip(paths).map(|(k, p)| Ok((k, Output::prepare(p)?))).collect()
}

/// Refuses a name that does not end in `.dng`.
pub fn prepare_dng(path: &Path) -> anyhow::Result<Output> {
    match kind(path)? {
        Kind::Dng => Output::prepare(path),
        _ if path.extension().is_none() => Output::prepare(path),
        _ => Err(UsageError(anyhow!("{}: expected a name that ends in .dng", path.display())).into()),
    }
}

/// Refuses a name that does not end in `.exr`.
pub fn prepare_exr(path: &Path) -> anyhow::Result<Output> {
    match kind(path)? {
        Kind::Exr => Output::prepare(path),
        _ if path.extension().is_none() => Output::prepare(path),
        _ => Err(UsageError(anyhow!("{}: expected a name that ends in .exr", path.display())).into()),
    }
}

/// How pictures are written.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// Of JPEG, 1 to 100.
    pub quality: u8,
    /// Of JPEG: with a gain map for brighter displays.
    pub gain_map: bool,
    /// Of PNG.
    pub depth: png::Depth,
    /// Of DNG.
    pub storage: Storage,
}

impl Default for Format {
    fn default() -> Self {
        Format { quality: JPEG_QUALITY, gain_map: false, depth: png::Depth::Eight, storage: Storage::Sixteen }
    }
}

/// Develops and writes all pictures, by rows. An EXR gets the light of the scene without a curve, a DNG the raw image; pictures to look at are made of
/// `denoised`, if it is there.
pub fn write_pictures(
    outputs: Vec<(Kind, Output)>,
    raw: &RawImage,
    denoised: Option<&RawImage>,
    recipe: &Recipe,
    lut: Option<&Lut>,
    format: Format,
) -> anyhow::Result<Vec<PathBuf>> {
    let write = |(kind, output): (Kind, Output)| {
        let raw = denoised.filter(|_| kind.is_looked_at()).unwrap_or(raw);
        if kind == Kind::Dng {
            if !raw.header.opcodes.is_empty() {
                let names: Vec<String> = raw.header.opcodes.iter().map(|o| o.to_string()).collect();
                let path = output.path.display();
                warn(&format!(
                    "{path}: corrections of the raw file that come behind its demosaic are not written: {}",
                    names.join(", ")
                ));
            }
            return output.commit(|to| Ok(raw_file::write_image(raw, format.storage, &Recipe::default(), to)?));
        }
        let light = recipe.linear_light();
        let (recipe, lut) = if kind == Kind::Exr { (&light, None) } else { (recipe, lut.cloned()) };
        let mut bright = recipe.clone();
        bright.output.encoding = Encoding::Pq;
        let hdr = match kind == Kind::Jpeg && format.gain_map {
            true => Some(Developer::new(raw, &bright, lut.clone()).map_err(ShotError::from)?),
            false => None,
        };
        let picture = Developer::new(raw, recipe, lut).map_err(ShotError::from)?;
        output.commit(|to| {
            match kind {
                Kind::Jpeg => match &hdr {
                    Some(hdr) => gain_map::write(&picture, hdr, format.quality, to)?,
                    None => jpeg::write(&picture, format.quality, to)?,
                },
                Kind::Tiff => tiff_file::write(&picture, to)?,
                Kind::Exr => exr::write_picture(&picture, exr::Precision::Half, to)?,
                _ => png::write(&picture, format.depth, to)?,
            }
            Ok(())
        })
    };
    outputs.into_iter().map(write).collect()
}

/// Writes a developed picture.
pub fn write_picture(kind: Kind, output: Output, picture: &Picture) -> anyhow::Result<PathBuf> {
    output.commit(|to| {
        match kind {
            Kind::Jpeg => jpeg::write(picture, JPEG_QUALITY, to)?,
            Kind::Tiff => tiff_file::write(picture, to)?,
            Kind::Exr => exr::write_picture(picture, exr::Precision::Half, to)?,
            _ => png::write(picture, png::Depth::Eight, to)?,
        }
        Ok(())
    })
}

/// Writes a file of truth, and where that is asked for the names of its Cryptomatte layers beside it (`NAME.CryptoObject.json` ...).
pub fn write_truth(
    output: Output,
    recorded: &Recorded,
    sidecar: bool,
    write: impl FnOnce(&Recorded, &mut BufWriter<File>) -> Result<(), ImageError>,
) -> anyhow::Result<Vec<PathBuf>> {
    if !sidecar {
        return Ok(vec![output.commit(|to| Ok(write(recorded, to)?))?]);
    }
    let stem = output.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let recorded = recorded.beside(&stem);
    // All are proved writable before the first is written.
    let manifests = recorded.manifests.iter().filter_map(|m| Some((output.path.with_file_name(m.sidecar.as_ref()?), m)));
    let manifests = manifests.map(|(path, m)| Ok((Output::prepare(&path)?, m))).collect::<anyhow::Result<Vec<_>>>()?;
    let mut written = vec![output.commit(|to| Ok(write(&recorded, to)?))?];
    for (output, manifest) in manifests {
        written.push(output.commit(|to| Ok(to.write_all(manifest.sidecar_json().as_bytes())?))?);
    }
    Ok(written)
}

/// Writes a focal plane.
pub fn write_plane(output: Output, plane: &FocalPlane) -> anyhow::Result<PathBuf> {
    output.commit(|to| Ok(exr::write_focal_plane(plane, to)?))
}

/// Writes a focal plane that comes strip by strip.
pub fn write_strips(output: Output, source: &mut dyn FocalPlaneSource) -> anyhow::Result<PathBuf> {
    let mut unread = None;
    let written = output.commit(|to| {
        let wrote = exr::write_strips(source, to);
        // What is malformed was read, and is not the fault of what is written.
        unread = wrote.as_ref().err().filter(|e| matches!(e, ImageError::Malformed { .. })).map(ToString::to_string);
        Ok(wrote?)
    });
    unread.map_or(written, |why| Err(anyhow!(why)))
}

/// The time, as EXIF writes it (UTC); `SOURCE_DATE_EPOCH` (seconds) wins, for files that are the same each time.
pub fn now() -> String {
    let told = std::env::var("SOURCE_DATE_EPOCH").ok().and_then(|s| s.parse().ok()).map(std::time::Duration::from_secs);
    let time = told.map_or_else(std::time::SystemTime::now, |d| std::time::UNIX_EPOCH + d);
    // 2026-11-21T13:01:36Z
    let text = humantime::format_rfc3339_seconds(time).to_string();
    text.trim_end_matches('Z').replace('-', ":").replace('T', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn what_a_link_points_to_is_written() {
        let folder = std::env::temp_dir().join(format!("diopter-links-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("away")).unwrap();
        let at = |name: &str| folder.join(name);
        let link = |to: &str, name: &str| std::os::unix::fs::symlink(to, at(name)).unwrap();
        std::fs::write(at("away/old.jpg"), b"old").unwrap();
        link("away/old.jpg", "a.jpg");
        link("a.jpg", "b.jpg");
        // What it points to is not there yet.
        link("away/new.jpg", "c.jpg");
        link("circle.jpg", "circle.jpg");
        for (name, target) in [("b.jpg", "away/old.jpg"), ("c.jpg", "away/new.jpg")] {
            let written = Output::prepare(&at(name)).unwrap().commit(|w| Ok(w.write_all(b"new")?)).unwrap();
            assert_eq!(written, at(name));
            assert_eq!(std::fs::read(at(target)).unwrap(), b"new", "{name}");
            assert!(std::fs::symlink_metadata(at(name)).unwrap().is_symlink(), "{name}");
        }
        let circle = Output::prepare(&at("circle.jpg")).err().unwrap();
        let left = std::fs::read_dir(at("away")).unwrap().count();
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(format!("{circle:#}").contains("circle.jpg: cannot be written"), "{circle:#}");
        assert_eq!(left, 2, "parts are left");
    }

    #[cfg(unix)]
    #[test]
    fn devices_are_written_into_and_stay() {
        use std::os::unix::fs::FileTypeExt;
        let null = Path::new("/dev/null");
        assert!(is_stream(null) && is_device(null) && is_stream(Path::new("/dev/stdout")));
        assert_eq!(kind(null).unwrap(), Kind::Jpeg);
        assert_eq!(Standard::named(Path::new("/dev/fd/2")), Some(Standard::Error));
        let output = Output::prepare(null).unwrap();
        let part = output.part.clone();
        assert!(part.exists() && !part.starts_with("/dev"));
        output.commit(|w| Ok(w.write_all(b"gone")?)).unwrap();
        assert!(!part.exists() && std::fs::metadata(null).unwrap().file_type().is_char_device());
        // Any number of files may go there, but not two to one file.
        assert!(distinct([], [null, null]).is_ok());
        assert!(distinct([], [Path::new("a.jpg"), Path::new("./a.jpg")]).is_err());
        assert!(!is_stream(Path::new("Cargo.toml")) && !is_stream(Path::new("/")));
        let gone = format!("{:#}", Output::prepare(Path::new("/nonexistent/dir/a.jpg")).err().unwrap());
        assert_eq!(gone, "/nonexistent/dir/a.jpg: cannot be written: there is no folder /nonexistent");
        let folder = Output::prepare(Path::new("/")).err().unwrap().to_string();
        assert!(folder.contains("expected the name of a file"), "{folder}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_dead_processes_left_is_removed() {
        let folder = std::env::temp_dir().join(format!("diopter-orphans-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        // Process numbers end at 2^22.
        let [dead, alive, away] =
            [part_name("a.jpg", machine(), 1 << 23), part_name("a.jpg", machine(), 1), part_name("a.jpg", "elsewhere", 1 << 23)]
                .map(|name| folder.join(name));
        for part in [&dead, &alive, &away] {
            std::fs::write(part, b"part").unwrap();
        }
        drop(Output::prepare(&folder.join("b.jpg")).unwrap());
        let left = [&dead, &alive, &away].map(|p| p.exists());
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(left, [false, true, true]);
    }
}
