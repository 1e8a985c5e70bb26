//! Which stray light is in a picture: the words of `--stray`.

/// Which stray light is in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stray {
    /// Light of lamps that is reflected twice between surfaces, or between the sensor and a surface.
    pub ghosts: bool,
    /// Light that aperture and blades diffract, where it shows.
    pub diffraction: bool,
    /// Veiling glare: light scattered by surfaces, barrel and edges, and the reflections of all that is no lamp.
    pub scatter: bool,
}

impl Stray {
    /// None.
    pub const NONE: Stray = Stray { ghosts: false, diffraction: false, scatter: false };
    /// All.
    pub const ALL: Stray = Stray { ghosts: true, diffraction: true, scatter: true };
    /// Their words, in the order in which they are written.
    pub const WORDS: [(&'static str, Stray); 3] = [
        ("ghosts", Stray { ghosts: true, ..Stray::NONE }),
        ("diffraction", Stray { diffraction: true, ..Stray::NONE }),
        ("scatter", Stray { scatter: true, ..Stray::NONE }),
    ];

    /// `all`, `none`, or some words with commas between them; `None` for anything else.
    pub fn by_name(name: &str) -> Option<Self> {
        match name {
            "all" => return Some(Stray::ALL),
            "none" => return Some(Stray::NONE),
            _ => (),
        }
        name.split(',').try_fold(Stray::NONE, |sum, word| {
            let found = Stray::WORDS.iter().find(|w| w.0 == word.trim())?.1;
            Some(sum.with(found))
        })
    }

    /// Both together.
    pub fn with(self, other: Stray) -> Stray {
        Stray {
            ghosts: self.ghosts || other.ghosts,
            diffraction: self.diffraction || other.diffraction,
            scatter: self.scatter || other.scatter,
        }
    }

    /// As it is written.
    pub fn name(self) -> String {
        match self {
            Stray::NONE => "none".into(),
            Stray::ALL => "all".into(),
            some => {
                let words = Stray::WORDS.iter().filter(|w| some.with(w.1) == some).map(|w| w.0);
                words.collect::<Vec<_>>().join(",")
            }
        }
    }

    /// What can be written, for messages.
    pub fn expected() -> String {
        format!("all, none, or some of {} with commas between them", Stray::WORDS.map(|w| w.0).join(", "))
    }

    /// Whether any of it is made beside the exposure (diffraction is part of it).
    pub fn is_added(self) -> bool {
        self.ghosts || self.scatter
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_as_they_are_written() {
        for k in 0..8 {
            let stray = Stray { ghosts: k & 1 > 0, diffraction: k & 2 > 0, scatter: k & 4 > 0 };
            assert_eq!(Stray::by_name(&stray.name()), Some(stray), "{}", stray.name());
        }
        assert_eq!(Stray::by_name("scatter, ghosts").map(Stray::name).as_deref(), Some("ghosts,scatter"));
        assert_eq!([Stray::by_name("veil"), Stray::by_name(""), Stray::by_name("ghosts,all")], [None; 3]);
    }
}
