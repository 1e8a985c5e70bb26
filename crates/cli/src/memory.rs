//! Pictures that memory cannot hold are refused before the work begins.

use crate::UsageError;
use crate::watch::warn;
use anyhow::anyhow;
use diopter::memory::{Bytes, available};
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
    let hint = if allowed.is_none() { " (--max-memory sets another limit)" } else { "" };
    shot.check_memory(kept, allowed).map_err(|e| UsageError(anyhow!("{e}{hint}")).into())
}
