//! Files while they are written: under hidden names of their own, which say whose they are, so that what a killed process left can be removed.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Files that are being written, under the names they have meanwhile.
static PARTS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Folders that were searched for what dead processes left.
#[cfg(target_os = "linux")]
static SEARCHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Most bytes of a file's name that the name of its part repeats: with what is added, no more than file systems take.
const PART_NAME: usize = 200;

/// Notes that a part is being written.
pub fn note_part(part: PathBuf) {
    PARTS.lock().unwrap_or_else(PoisonError::into_inner).push(part);
}

/// Forgets a part: it is whole, or given up.
pub fn forget_part(part: &Path) {
    PARTS.lock().unwrap_or_else(PoisonError::into_inner).retain(|p| p != part);
}

/// Removes what is being written: for a process that ends at once.
pub fn remove_parts() {
    for part in PARTS.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        let _ = std::fs::remove_file(part);
    }
}

/// The name of a file while it is written: whose it is, by machine and process.
pub fn part_name(name: &str, machine: &str, process: u32) -> String {
    format!(".{}.{machine}-{process}.part", cut(name))
}

/// A name that something can be added to: no longer than [`PART_NAME`] and a hash, which tells names apart that differ behind.
pub fn cut(name: &str) -> String {
    let end = name.floor_char_boundary(PART_NAME);
    let rest = if end < name.len() { format!("~{:08x}", hash(name)) } else { String::new() };
    format!("{}{rest}", &name[..end])
}

/// FNV-1a of 32 bits (Fowler, Noll & Vo 1991).
fn hash(text: &str) -> u32 {
    text.bytes().fold(0x811c_9dc5, |h: u32, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193))
}

/// The process of this machine that a part belongs to.
fn owner(name: &str, machine: &str) -> Option<u32> {
    let (_, who) = name.strip_prefix('.')?.strip_suffix(".part")?.rsplit_once('.')?;
    who.strip_prefix(machine)?.strip_prefix('-')?.parse().ok()
}

/// Stands for this machine and its process numbers (containers have their own): folders are shared over networks, where a process that is not here may
/// well be alive.
pub fn machine() -> &'static str {
    static NAME: OnceLock<String> = OnceLock::new();
    NAME.get_or_init(|| {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let numbers = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
        let text = format!("{} {} {}", read("/etc/machine-id"), read("/proc/sys/kernel/hostname"), numbers.display());
        format!("{:08x}", hash(&text))
    })
}

/// Removes the parts in a folder that processes of this machine and user left when they were killed; once for each folder.
#[cfg(target_os = "linux")]
pub fn remove_orphans(folder: &Path) {
    use std::os::unix::fs::MetadataExt;
    let mut searched = SEARCHED.lock().unwrap_or_else(PoisonError::into_inner);
    if searched.iter().any(|f| f == folder) {
        return;
    }
    searched.push(folder.to_owned());
    // A process of another user may be hidden; one of this user is not.
    let (Ok(own), Ok(entries)) = (std::fs::metadata("/proc/self"), std::fs::read_dir(folder)) else { return };
    for entry in entries.flatten() {
        let Some(process) = entry.file_name().to_str().and_then(|name| owner(name, machine())) else { continue };
        let dead = !Path::new(&format!("/proc/{process}")).exists();
        if dead && entry.metadata().is_ok_and(|m| m.is_file() && m.uid() == own.uid()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Elsewhere nothing tells whether a process is alive: parts stay.
#[cfg(not(target_os = "linux"))]
pub fn remove_orphans(_: &Path) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_know_whose_they_are() {
        let name = part_name("a photo.jpg", "0123abcd", 77);
        assert_eq!(
            (name.as_str(), owner(&name, "0123abcd"), owner(&name, "0123abce")),
            (".a photo.jpg.0123abcd-77.part", Some(77), None)
        );
        assert!(part_name(&"ü".repeat(121), "0123abcd", u32::MAX).len() <= 255);
        let long = |end: char| part_name(&format!("{}{end}", "a".repeat(240)), "0123abcd", 1);
        assert!(long('1') != long('2') && long('1').len() <= 255);
        for other in
            ["photo.jpg", ".photo.jpg.77.part", ".photo.jpg.0123abcd-.part", "photo.jpg.0123abcd-77.part", ".0123abcd-77.part"]
        {
            assert_eq!(owner(other, "0123abcd"), None, "{other}");
        }
    }
}
