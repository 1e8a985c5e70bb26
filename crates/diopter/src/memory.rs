//! Memory of the machine: what can be had, and amounts of it as people write them.

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

/// Memory that a picture may take: what is `allowed`, without it what is free; `None` where the system does not say.
pub fn available(allowed: Option<Bytes>) -> Option<u64> {
    allowed.map(|Bytes(bytes)| bytes).or_else(free)
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
