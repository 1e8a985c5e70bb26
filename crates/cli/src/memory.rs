//! Pictures that memory cannot hold are refused before the work begins.

use crate::UsageError;
use crate::watch::warn;
use anyhow::anyhow;
use diopter::shot::{ExposureUse, FireflyChoice, Shot};

/// Where a focal plane has room while it is exposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Room {
    /// In memory.
    Memory,
    /// In a temporary file, with so many bytes of it in memory.
    Disk(usize),
}

/// Finds room for a focal plane: in memory if it fits into what is `allowed` (without it, in what is free). Refuses what has no room anywhere.
/// Fireflies are kept where the memory to re-weight them is not there.
pub fn room(shot: &mut Shot, allowed: Option<Bytes>) -> anyhow::Result<Room> {
    settle_fireflies(shot, ExposureUse::Plane, allowed);
    if let Some(available) = available(allowed)
        && shot.bytes_needed(ExposureUse::Plane) > available
        && shot.can_expose_rows()
        && shot.bytes_needed(ExposureUse::Strips) <= available
    {
        return Ok(Room::Disk(shot.cache_within(available)));
    }
    check(shot, ExposureUse::Plane, allowed)?;
    Ok(Room::Memory)
}

fn available(allowed: Option<Bytes>) -> Option<u64> {
    allowed.map(|Bytes(bytes)| bytes).or_else(free)
}

/// Keeps fireflies, and says so, where only without re-weighting them there is memory enough; then gathers the stars of lamps like all light, with their
/// noise.
pub fn settle_fireflies(shot: &mut Shot, kept: ExposureUse, allowed: Option<Bytes>) {
    let Some(available) = available(allowed) else { return };
    let needed = shot.bytes_needed(kept);
    if needed <= available {
        return;
    }
    let (reweighted, starred) = (shot.reweights(), shot.separates_starbursts());
    shot.fireflies = FireflyChoice::Keep;
    shot.starbursts = shot.bytes_needed(kept) <= available;
    if shot.bytes_needed(kept) > available {
        return;
    }
    let [needed, available] = [needed, available].map(Bytes);
    if reweighted {
        warn(&format!("fireflies are kept: re-weighting them takes {needed} of memory, and {available} can be had"));
    }
    if starred && !shot.starbursts {
        warn(&format!(
            "starbursts of lamps are noisy: without that noise the picture takes {needed} of memory, and {available} can be had"
        ));
    }
}

/// Refuses a shot that takes more memory than `allowed`, or, without it, than is free.
pub fn check(shot: &Shot, kept: ExposureUse, allowed: Option<Bytes>) -> anyhow::Result<()> {
    let Some(available) = available(allowed) else { return Ok(()) };
    let needed = shot.bytes_needed(kept);
    if needed <= available {
        return Ok(());
    }
    let limit = match allowed {
        Some(bytes) => format!("--max-memory allows {bytes}"),
        None => format!("{} are free (--max-memory sets another limit)", Bytes(available)),
    };
    let film = &shot.camera.film;
    let fits = match shot.largest_size(available, kept) {
        Some([width, height]) => format!("at most --size {width}x{height}"),
        None => "more memory".into(),
    };
    Err(UsageError(anyhow!(
        "size {}x{} in {} bands: the exposure takes {}, {limit}: expected {fits}",
        film.columns,
        film.rows,
        shot.bands(),
        Bytes(needed),
    ))
    .into())
}

/// An amount of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl std::fmt::Display for Bytes {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self.0 {
            b if b >= 1_000_000_000 => write!(f, "{:.1} GB", b as f64 / 1e9),
            b => write!(f, "{:.0} MB", b as f64 / 1e6),
        }
    }
}

impl std::str::FromStr for Bytes {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        const UNITS: [(&str, f64); 8] = [
            ("KiB", 1024.0),
            ("MiB", 1_048_576.0),
            ("GiB", 1_073_741_824.0),
            ("TiB", 1_099_511_627_776.0),
            ("KB", 1e3),
            ("MB", 1e6),
            ("GB", 1e9),
            ("TB", 1e12),
        ];
        let parsed = || {
            let text = text.trim();
            let cut = |unit: &str| text.split_at_checked(text.len().checked_sub(unit.len())?);
            let (number, factor) = UNITS.into_iter().find_map(|(unit, factor)| {
                let (number, end) = cut(unit)?;
                end.eq_ignore_ascii_case(unit).then_some((number, factor))
            })?;
            let bytes = number.trim().parse::<f64>().ok()? * factor;
            (1.0..=1e18).contains(&bytes).then_some(Bytes(bytes as u64))
        };
        parsed().ok_or_else(|| format!("\"{text}\" is not an amount of memory such as 4GB or 500MB"))
    }
}

/// Memory that can be had without swapping, in this machine and this container; `None` where the system does not say.
fn free() -> Option<u64> {
    let machine = entry(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")? * 1024;
    let read = |name: &str| std::fs::read_to_string(format!("/sys/fs/cgroup/{name}")).ok();
    let container = || {
        let most: u64 = read("memory.max")?.trim().parse().ok()?;
        Some(most.saturating_sub(entry(&read("memory.stat")?, "anon")?))
    };
    Some(container().map_or(machine, |c| c.min(machine)))
}

/// The number after a word at the beginning of a line.
fn entry(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name).filter(|rest| rest.starts_with(char::is_whitespace)))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_read() {
        let read = |text: &str| text.parse::<Bytes>().ok().map(|b| b.0);
        assert_eq!((read("4GB"), read("0.5 gib"), read("300 mb")), (Some(4_000_000_000), Some(536_870_912), Some(300_000_000)));
        for bad in ["", "4", "GB", "-4GB", "NaNGB", "1e30TB", "4 metres"] {
            assert_eq!(read(bad), None, "{bad}");
        }
        assert_eq!((Bytes(2_540_000_000).to_string(), Bytes(64_000_000).to_string()), ("2.5 GB".into(), "64 MB".into()));
    }

    #[test]
    fn what_the_system_says_is_found() {
        let text = "MemTotal:       16 kB\nMemAvailable:   12345 kB\nanonymous 1\nanon 77\n";
        assert_eq!((entry(text, "MemAvailable:"), entry(text, "anon"), entry(text, "file")), (Some(12345), Some(77), None));
    }
}
