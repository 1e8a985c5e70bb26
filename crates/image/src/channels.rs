//! The truth channels: what can be recorded of the scene beside the light, each with its unit, its names in files and how parts of an exposure merge.
//!
//! One table ([`CHANNELS`]) from which recording, EXR, merging, Python and the documentation take what they need. A new channel is an entry here and
//! the function that fills it in `diopter`'s `expose/truth.rs`; the documentation's table is written by `DIOPTER_WRITE_DOCS=1 cargo test -p diopter-image --lib channels`.
//! The first four are always recorded (denoising asks for them), the others where they are asked for.
//!
//! Channels along one ray (*nearest*) are taken along the chief ray of the pixel's middle, halfway through the time for which this pixel is open. The others
//! are weighted by coverage: over the samples of the pixel, each with its own place, point of the pupil and moment.

use crate::ImageError;

/// What the values of a channel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelType {
    /// 32-bit floating point.
    Float,
    /// 32-bit whole numbers: identifiers, which must not be averaged.
    Whole,
}

/// How the values of a pixel come from its samples, and those of a whole from its parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merge {
    /// Of one ray, the chief ray of the pixel's middle: all parts hold the same, and that of the part given first is taken.
    Nearest,
    /// Mean over the samples that channels look at ([`COVERAGE_SAMPLES`]): parts are weighted by their numbers of these.
    Mean,
    /// Mean over all samples of the picture: parts are weighted as their light is.
    Light,
    /// Pairs of identifier and coverage, most coverage first: coverage is weighted as a mean, identifier by identifier.
    Ranks,
}

impl Merge {
    /// In words, for documentation.
    pub fn name(self) -> &'static str {
        match self {
            Merge::Nearest => "nearest",
            Merge::Mean => "mean over samples",
            Merge::Light => "mean over all samples",
            Merge::Ranks => "coverage over samples",
        }
    }
}

/// A kind of truth.
#[derive(Debug)]
pub struct Channel {
    /// Which one it is, for what computes it: a channel without a function there does not compile.
    pub id: ChannelId,
    /// Name as users write it.
    pub name: &'static str,
    /// Names of its channels in EXR files, in the order of its values.
    pub exr: &'static [&'static str],
    /// What its values are.
    pub numbers: PixelType,
    /// Unit of its values; empty where there is none.
    pub unit: &'static str,
    /// How samples and parts merge.
    pub merge: Merge,
    /// What it reads where there is nothing to record.
    pub missing: f32,
    /// Whether it compares with other frames, which must then be known.
    pub needs_frames: bool,
    /// Whether it follows more than chief rays.
    pub needs_pupil: bool,
    /// One line for its users.
    pub about: &'static str,
}

/// The channels one by one, in the order of the table, which says what each is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum ChannelId {
    Depth,
    Normal,
    Albedo,
    Id,
    Position,
    Distance,
    Uv,
    Incidence,
    Coc,
    Pupil,
    Motion,
    Flow,
    BackwardFlow,
    Transmitted,
    Coverage,
    StrayLight,
    Direct,
    Indirect,
    CryptoObject,
    CryptoMaterial,
    CryptoClass,
    Class,
}

/// A name that is no channel's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownChannel {
    /// The name, in quotation marks.
    pub found: String,
    /// What there is.
    pub expected: String,
}

/// Samples of a pixel, from its first, that channels weighted by coverage look at: an exposure of more looks at these.
pub const COVERAGE_SAMPLES: u32 = 256;

/// Number of the channels that are always recorded: the first of the table.
pub const ALWAYS: usize = 4;

// Each entry is in the place of its number.
const _: () = {
    let mut i = 0;
    while i < CHANNELS.len() {
        assert!(CHANNELS[i].id as usize == i);
        i += 1;
    }
};

/// The entry of a channel.
const fn entry(id: ChannelId) -> &'static Channel {
    &CHANNELS[id as usize]
}

/// Depth: always recorded.
pub const DEPTH: &Channel = entry(ChannelId::Depth);
/// Shading normal: always recorded.
pub const NORMAL: &Channel = entry(ChannelId::Normal);
/// Albedo: always recorded.
pub const ALBEDO: &Channel = entry(ChannelId::Albedo);
/// Number of the object: always recorded.
pub const ID: &Channel = entry(ChannelId::Id);
/// What stray light changed: filled by what adds it.
pub const STRAY_LIGHT: &Channel = entry(ChannelId::StrayLight);
/// Direct light: filled by the sums of the exposure.
pub const DIRECT: &Channel = entry(ChannelId::Direct);
/// Indirect light: filled by the sums of the exposure.
pub const INDIRECT: &Channel = entry(ChannelId::Indirect);

/// Names of the EXR channels of a Cryptomatte layer: identifier and coverage of six ranks.
macro_rules! ranks {
    ($layer:literal) => {
        &[
            concat!($layer, "00.R"),
            concat!($layer, "00.G"),
            concat!($layer, "00.B"),
            concat!($layer, "00.A"),
            concat!($layer, "01.R"),
            concat!($layer, "01.G"),
            concat!($layer, "01.B"),
            concat!($layer, "01.A"),
            concat!($layer, "02.R"),
            concat!($layer, "02.G"),
            concat!($layer, "02.B"),
            concat!($layer, "02.A"),
        ]
    };
}

/// A Cryptomatte layer.
const fn cryptomatte(id: ChannelId, name: &'static str, exr: &'static [&'static str], about: &'static str) -> Channel {
    Channel {
        id,
        name,
        exr,
        numbers: PixelType::Float,
        unit: "",
        merge: Merge::Ranks,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: true,
        about,
    }
}

/// All channels; the first four are always recorded.
pub static CHANNELS: [Channel; 22] = [
    Channel {
        id: ChannelId::Depth,
        name: "depth",
        exr: &["Z"],
        numbers: PixelType::Float,
        unit: "m",
        merge: Merge::Nearest,
        missing: f32::INFINITY,
        needs_frames: false,
        needs_pupil: false,
        about: "distance from the middle of the entrance pupil (the camera's place, as in calibrations) along the camera's axis, whatever the projection (fisheyes and calibrated cameras, too; negative behind the camera, in fields over 180°); of a panorama, which has no axis, along the ray; infinite where nothing is hit",
    },
    Channel {
        id: ChannelId::Normal,
        name: "normal",
        exr: &["normal.X", "normal.Y", "normal.Z"],
        numbers: PixelType::Float,
        unit: "",
        merge: Merge::Nearest,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: false,
        about: "unit shading normal in world space, on the side that is seen; 0 where nothing is hit",
    },
    Channel {
        id: ChannelId::Albedo,
        name: "albedo",
        exr: &["albedo.R", "albedo.G", "albedo.B"],
        numbers: PixelType::Float,
        unit: "linear sRGB",
        merge: Merge::Nearest,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: false,
        about: "albedo of the surface; 0 where nothing is hit",
    },
    Channel {
        id: ChannelId::Id,
        name: "id",
        exr: &["id"],
        numbers: PixelType::Whole,
        unit: "",
        merge: Merge::Nearest,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: false,
        about: "number of the object (instance) plus one; 0 where nothing is hit",
    },
    Channel {
        id: ChannelId::Position,
        name: "position",
        exr: &["P.X", "P.Y", "P.Z"],
        numbers: PixelType::Float,
        unit: "m",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: false,
        needs_pupil: false,
        about: "place of the surface in world space; not a number where nothing is hit",
    },
    Channel {
        id: ChannelId::Distance,
        name: "distance",
        exr: &["distance"],
        numbers: PixelType::Float,
        unit: "m",
        merge: Merge::Nearest,
        missing: f32::INFINITY,
        needs_frames: false,
        needs_pupil: false,
        about: "distance along the chief ray from the middle of the entrance pupil; infinite where nothing is hit",
    },
    Channel {
        id: ChannelId::Uv,
        name: "uv",
        exr: &["UV.U", "UV.V"],
        numbers: PixelType::Float,
        unit: "",
        merge: Merge::Nearest,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: false,
        about: "first texture coordinates of the surface; 0 where there are none",
    },
    Channel {
        id: ChannelId::Incidence,
        name: "incidence",
        exr: &["incidence"],
        numbers: PixelType::Float,
        unit: "rad",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: false,
        needs_pupil: false,
        about: "angle between the chief ray and the geometric normal, 0 to π/2; not a number where nothing is hit",
    },
    Channel {
        id: ChannelId::Coc,
        name: "coc",
        exr: &["coc"],
        numbers: PixelType::Float,
        unit: "px",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: false,
        needs_pupil: true,
        about: "diameter of the circle of confusion of what is seen, through the lens as it is; negative before the sharp plane",
    },
    Channel {
        id: ChannelId::Pupil,
        name: "pupil",
        exr: &["pupil"],
        numbers: PixelType::Float,
        unit: "",
        merge: Merge::Nearest,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: true,
        about: "fraction of the pupil that is open towards this place of the film, of that on the axis: vignetting",
    },
    Channel {
        id: ChannelId::Motion,
        name: "motion",
        exr: &["motion.X", "motion.Y", "motion.Z"],
        numbers: PixelType::Float,
        unit: "m",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: true,
        needs_pupil: false,
        about: "way of the point of the surface in world space until the next frame; not a number where nothing is hit",
    },
    Channel {
        id: ChannelId::Flow,
        name: "flow",
        exr: &["forward.u", "forward.v"],
        numbers: PixelType::Float,
        unit: "px",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: true,
        needs_pupil: false,
        about: "where the point of the surface lies in the next frame, from here: to the right and down, through lens, motion and shutter; not a number where the lens does not show it",
    },
    Channel {
        id: ChannelId::BackwardFlow,
        name: "backward-flow",
        exr: &["backward.u", "backward.v"],
        numbers: PixelType::Float,
        unit: "px",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: true,
        needs_pupil: false,
        about: "the same in the frame before",
    },
    Channel {
        id: ChannelId::Transmitted,
        name: "transmitted",
        exr: &["transmitted.X", "transmitted.Y", "transmitted.Z"],
        numbers: PixelType::Float,
        unit: "m",
        merge: Merge::Nearest,
        missing: f32::NAN,
        needs_frames: false,
        needs_pupil: false,
        about: "place in world space of the first surface that is neither smooth glass nor mirror, along the way that more light takes; not a number where there is none",
    },
    Channel {
        id: ChannelId::Coverage,
        name: "coverage",
        exr: &["coverage"],
        numbers: PixelType::Float,
        unit: "",
        merge: Merge::Mean,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: true,
        about: "fraction of the pixel's samples that meet a surface",
    },
    Channel {
        id: ChannelId::StrayLight,
        name: "stray-light",
        exr: &["stray.R", "stray.G", "stray.B"],
        numbers: PixelType::Float,
        unit: "e⁻",
        merge: Merge::Light,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: false,
        about: "what ghosts and veiling glare add to the mean of red, green and blue (of other bands: the first, the middle and the last); negative where scatter takes light away: the mean without it is the picture without them",
    },
    Channel {
        id: ChannelId::Direct,
        name: "direct",
        exr: &["direct.R", "direct.G", "direct.B"],
        numbers: PixelType::Float,
        unit: "e⁻",
        merge: Merge::Light,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: true,
        about: "what of the mean of red, green and blue (of other bands: the first, the middle and the last) was emitted towards the camera or scattered once on its way; of films of radiance in their unit",
    },
    Channel {
        id: ChannelId::Indirect,
        name: "indirect",
        exr: &["indirect.R", "indirect.G", "indirect.B"],
        numbers: PixelType::Float,
        unit: "e⁻",
        merge: Merge::Light,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: true,
        about: "what was scattered more often: with direct light (and stray light) the mean before it is denoised",
    },
    cryptomatte(
        ChannelId::CryptoObject,
        "crypto-object",
        ranks!("CryptoObject"),
        "Cryptomatte: names of objects as hashes and how much of the pixel each covers, six ranks; the manifest is in the header",
    ),
    cryptomatte(
        ChannelId::CryptoMaterial,
        "crypto-material",
        ranks!("CryptoMaterial"),
        "Cryptomatte: names of materials as hashes and how much of the pixel each covers, six ranks; the manifest is in the header",
    ),
    cryptomatte(
        ChannelId::CryptoClass,
        "crypto-class",
        ranks!("CryptoClass"),
        "Cryptomatte: classes of objects as hashes and how much of the pixel each covers, six ranks; the manifest is in the header",
    ),
    Channel {
        id: ChannelId::Class,
        name: "class",
        exr: &["class"],
        numbers: PixelType::Whole,
        unit: "",
        merge: Merge::Nearest,
        missing: 0.0,
        needs_frames: false,
        needs_pupil: false,
        about: "number of the object's class plus one, those of a table first, in its order, then others in order of their names; 0 where nothing is hit",
    },
];

impl PartialEq for Channel {
    /// Names are unique.
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Channel {
    /// Values a pixel.
    pub fn parts(&self) -> usize {
        self.exr.len()
    }

    /// Bytes a pixel in memory.
    pub fn bytes(&self) -> usize {
        4 * self.parts()
    }

    /// Name of the Cryptomatte layer of its ranks: that of the EXR channels without rank and component.
    pub fn matte_layer(&self) -> &'static str {
        self.exr[0].split(|c: char| c.is_ascii_digit() || c == '.').next().unwrap_or_default()
    }

    /// Whether it is recorded without being asked for.
    pub fn is_always(&self) -> bool {
        CHANNELS[..ALWAYS].iter().any(|c| c.name == self.name)
    }

    /// The channel of a name.
    pub fn named(name: &str) -> Option<&'static Channel> {
        CHANNELS.iter().find(|c| c.name == name)
    }

    /// Channels of a list of names with commas between them, in the order of the table; those that are always recorded come along. `all` names every
    /// one. Fails with the name that is none and what there is.
    pub fn list(names: &str) -> Result<Vec<&'static Channel>, UnknownChannel> {
        let mut asked = Vec::new();
        for name in names.split(',').map(str::trim).filter(|n| !n.is_empty()) {
            if name == "all" {
                asked.extend(&CHANNELS);
                continue;
            }
            asked.push(Channel::named(name).ok_or_else(|| {
                // `join` of names that are known when this is compiled takes LLVM 22 three minutes (`ConstraintEliminationPass`).
                let all = CHANNELS.iter().fold(String::new(), |all, c| all + c.name + ", ");
                UnknownChannel {
                    found: format!("\"{name}\""),
                    expected: format!("all, or some of {all}with commas between them"),
                }
            })?);
        }
        Ok(CHANNELS.iter().filter(|c| c.is_always() || asked.contains(c)).collect())
    }
}

/// Those of the table for which a file has all its channels. Fails with the name that is missing of a channel that is always recorded.
pub(crate) fn found_in(has: impl Fn(&str) -> bool) -> Result<Vec<&'static Channel>, ImageError> {
    let mut found = Vec::with_capacity(CHANNELS.len());
    for channel in &CHANNELS {
        match channel.exr.iter().find(|name| !has(name)) {
            None => found.push(channel),
            Some(name) if channel.is_always() => {
                return Err(ImageError::Missing {
                    what: format!("the channel \"{name}\""),
                    hint: "the file was written or cut by another program".into(),
                });
            }
            Some(_) => (),
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_are_unique_and_found() {
        let names: BTreeSet<&str> = CHANNELS.iter().map(|c| c.name).collect();
        let exr: Vec<&str> = CHANNELS.iter().flat_map(|c| c.exr).copied().collect();
        assert_eq!(names.len(), CHANNELS.len());
        assert_eq!(exr.iter().collect::<BTreeSet<_>>().len(), exr.len());
        assert!(CHANNELS.iter().all(|c| Channel::named(c.name) == Some(c) && !c.exr.is_empty()));
        assert_eq!([DEPTH, NORMAL, ALBEDO, ID].map(|c| c.name), ["depth", "normal", "albedo", "id"]);
        assert_eq!([STRAY_LIGHT, DIRECT, INDIRECT].map(|c| c.name), ["stray-light", "direct", "indirect"]);
        assert!([DEPTH, NORMAL, ALBEDO, ID].iter().all(|c| c.merge == Merge::Nearest && c.is_always()));
    }

    #[test]
    fn the_documentation_has_the_table() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/truth.md");
        let docs = std::fs::read_to_string(path).unwrap();
        let row = |c: &Channel| {
            let unit = if c.unit.is_empty() { "–" } else { c.unit };
            format!("| `{}` | {} | {unit} | {} | {} |\n", c.name, exr_names(c), c.merge.name(), c.about)
        };
        let table: String = CHANNELS.iter().map(row).collect();
        let start = docs.find("| `depth`").expect("docs/truth.md has a table");
        let end = start + docs[start..].find("\n\n").expect("the table ends") + 1;
        if std::env::var_os("DIOPTER_WRITE_DOCS").is_some() {
            return std::fs::write(path, [&docs[..start], &table, &docs[end..]].concat()).unwrap();
        }
        assert_eq!(&docs[start..end], table, "DIOPTER_WRITE_DOCS=1 cargo test -p diopter-image --lib channels writes it");
    }

    /// Names in files, as the documentation has them: what is common to all only once.
    fn exr_names(channel: &Channel) -> String {
        match channel.exr {
            [one] => format!("`{one}`"),
            [first, .., last] => format!("`{first}` … `{last}`"),
            [] => String::new(),
        }
    }

    #[test]
    fn lists_hold_what_is_always_recorded_and_refuse_other_names() {
        assert_eq!(Channel::list("").unwrap().len(), ALWAYS);
        assert_eq!(Channel::list(" id, depth").unwrap().len(), ALWAYS);
        assert_eq!(Channel::list("all").unwrap().len(), CHANNELS.len());
        let e = Channel::list("depth,deepness").unwrap_err();
        assert!(e.found == "\"deepness\"" && e.expected.contains("normal"), "{e:?}");
    }
}
