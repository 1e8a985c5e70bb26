//! Which files a page may name: those of the command line, and what lies in the folders that it names.

use diopter::lens::import;
use diopter::scene::builtin;
use diopter::shot::{ShotError, ShotFile};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Folders that the command line names, links followed.
#[derive(Clone, Debug, Default)]
pub struct Folders {
    folders: Vec<PathBuf>,
}

/// A file that a shot names.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Named {
    setting: &'static str,
    path: String,
}

/// Files of the folders that a page offers, by what they are for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Offered {
    /// Scenes.
    pub scenes: Vec<String>,
    /// Pictures of light.
    pub lights: Vec<String>,
    /// Lenses.
    pub lenses: Vec<String>,
    /// Look-up tables.
    pub tables: Vec<String>,
}

/// Most files that are offered, and folders within folders that are looked into.
const MOST_OFFERED: usize = 500;
const DEEPEST: usize = 3;

impl Folders {
    /// Fails where one cannot be read.
    pub fn new(folders: &[PathBuf]) -> Result<Folders, ShotError> {
        let whole = |f: &PathBuf| {
            let found = f.canonicalize().and_then(|p| match p.is_dir() {
                true => Ok(p),
                false => Err(std::io::Error::from(std::io::ErrorKind::NotADirectory)),
            });
            found.map_err(|e| ShotError::Read { path: f.display().to_string(), reason: e.to_string() })
        };
        Ok(Folders { folders: folders.iter().map(whole).collect::<Result<_, _>>()? })
    }

    /// Whether a file lies in one of the folders. One that is not there lies nowhere: reading it fails by itself, with the words for that.
    fn holds(&self, path: &str) -> bool {
        // A build of a tolerance sheet is named by file and number.
        let file = path.rsplit_once('#').map_or(path, |(file, _)| file);
        let exists = |p: &str| Path::new(p).exists();
        if !exists(path) && !exists(file) {
            return true;
        }
        let found = Path::new(if exists(path) { path } else { file }).canonicalize();
        found.is_ok_and(|p| p.is_file() && self.folders.iter().any(|f| p.starts_with(f)))
    }

    /// Fails where a shot names a file that neither the first shot named nor a folder holds.
    pub fn check(&self, shot: &ShotFile, first: &ShotFile) -> Result<(), ShotError> {
        let known = named(first);
        for file in named(shot) {
            // A library is code, not data: only the command line names it.
            let allowed = known.contains(&file) || file.setting != "oidn" && self.holds(&file.path);
            if !allowed {
                return Err(ShotError::Value {
                    what: file.setting.into(),
                    found: format!("\"{}\"", file.path),
                    expected: "a file of the command line, or in a folder that it names (--folder FOLDER)".into(),
                });
            }
        }
        Ok(())
    }

    /// What the folders hold, in the order of names.
    pub fn offered(&self) -> Offered {
        let mut files = Vec::new();
        self.folders.iter().for_each(|f| collect(f, 0, &mut files));
        files.sort();
        let mut offered = Offered::default();
        for path in files.into_iter().filter(|p| self.holds(p)) {
            let ending = Path::new(&path).extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            match ending.as_str() {
                "gltf" | "glb" | "pbrt" | "ply" | "obj" | "stl" | "scene" | "spz" | "xml" | "usd" | "usda" | "usdc" | "usdz" => {
                    offered.scenes.push(path)
                }
                "hdr" | "exr" | "pfm" => offered.lights.push(path),
                "cube" => offered.tables.push(path),
                // TOML files are of many kinds.
                "toml" => {}
                _ if import::Format::of(&path).is_some() => offered.lenses.push(path),
                _ => {}
            }
        }
        offered
    }
}

fn collect(folder: &Path, depth: usize, files: &mut Vec<String>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        if files.len() >= MOST_OFFERED {
            return;
        }
        let path = entry.path();
        match entry.file_type() {
            Ok(kind) if kind.is_dir() && depth < DEEPEST => collect(&path, depth + 1, files),
            Ok(kind) if kind.is_file() => files.extend(path.to_str().map(str::to_owned)),
            _ => {}
        }
    }
}

/// All files that a shot names.
fn named(shot: &ShotFile) -> Vec<Named> {
    let (s, c) = (&shot.scene, &shot.camera);
    let path = |p: &Option<PathBuf>| p.as_ref().map(|p| p.display().to_string());
    let lens = c.lens.clone().filter(|l| diopter::lens::embedded(l).is_none());
    let table = Some(shot.develop.lut.file.clone()).filter(|f| !f.is_empty());
    let all = [
        ("scene", s.file.clone().filter(|f| !builtin::is_embedded(f))),
        ("light", s.light.clone()),
        ("environment", path(&s.environment)),
        ("classes", path(&s.classes)),
        ("body", c.body.clone()),
        ("lens", lens),
        ("calibration", path(&c.calibration)),
        ("aperture_image", path(&c.aperture_image)),
        ("oidn", path(&shot.render.oidn)),
        ("lut.file", table),
    ];
    all.into_iter().filter_map(|(setting, path)| path.map(|path| Named { setting, path })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_path_leaves_the_folders() {
        let room = tempfile::tempdir().unwrap();
        let [inside, outside] = ["inside", "outside"].map(|n| room.path().join(n));
        for folder in [&inside, &outside, &inside.join("deeper")] {
            std::fs::create_dir_all(folder).unwrap();
            std::fs::write(folder.join("a.glb"), b"x").unwrap();
        }
        let folders = Folders::new(std::slice::from_ref(&inside)).unwrap();
        let shot = |path: &Path| {
            let mut file = ShotFile::default();
            file.scene.file = Some(path.display().to_string());
            file
        };
        let first = shot(&outside.join("a.glb"));
        let nobody = ShotFile::default();
        let passes = |path: &Path, first: &ShotFile| folders.check(&shot(path), first).is_ok();
        assert!(passes(&inside.join("a.glb"), &nobody) && passes(&inside.join("deeper/a.glb"), &nobody));
        assert!(passes(Path::new("still-life"), &nobody));
        assert!(!passes(&outside.join("a.glb"), &nobody));
        assert!(!passes(&inside.join("../outside/a.glb"), &nobody));
        // The one of the command line.
        assert!(passes(&outside.join("a.glb"), &first));
        // What is not there is somebody else's error.
        assert!(passes(&outside.join("b.glb"), &nobody));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(outside.join("a.glb"), inside.join("link.glb")).unwrap();
            assert!(!passes(&inside.join("link.glb"), &nobody));
        }
        assert_eq!(folders.offered().scenes.len(), 2);
        let error = folders.check(&shot(&outside.join("a.glb")), &nobody).unwrap_err().parts();
        assert!(error.expected.is_some_and(|e| e.contains("--folder")));
        // Code is not loaded from anywhere.
        let mut library = ShotFile::default();
        library.render.oidn = Some(inside.join("a.glb"));
        assert!(folders.check(&library, &nobody).is_err());
        assert!(Folders::new(&[room.path().join("nowhere")]).is_err());
    }

    #[test]
    fn lenses_and_bodies_are_files_too() {
        let room = tempfile::tempdir().unwrap();
        let path = room.path().join("lens.toml");
        std::fs::write(&path, "").unwrap();
        let text = path.display().to_string();
        let none = Folders::default();
        let changes: [fn(&mut ShotFile, &str); 9] = [
            |f, p| f.camera.lens = Some(p.into()),
            |f, p| f.camera.lens = Some(format!("{p}#3")),
            |f, p| f.camera.body = Some(p.into()),
            |f, p| f.scene.light = Some(p.into()),
            |f, p| f.scene.environment = Some(p.into()),
            |f, p| f.scene.classes = Some(p.into()),
            |f, p| f.camera.aperture_image = Some(p.into()),
            |f, p| f.develop.lut.file = p.into(),
            |f, p| f.camera.calibration = Some(p.into()),
        ];
        for change in changes {
            let mut shot = ShotFile::default();
            change(&mut shot, &text);
            assert!(none.check(&shot, &ShotFile::default()).is_err());
            assert!(none.check(&shot, &shot).is_ok());
        }
        let mut embedded = ShotFile::default();
        (embedded.camera.lens, embedded.camera.body) = (Some("tessar-50mm-f2.8".into()), Some("canon-5d".into()));
        assert!(none.check(&embedded, &ShotFile::default()).is_ok());
    }
}
