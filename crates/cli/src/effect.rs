//! Options that only some kinds of files heed: one table, so that none is without effect and without a word.

use crate::UsageError;
use crate::output::Kind;
use anyhow::anyhow;

/// An option that was typed, with its value; `None` where it was not.
pub type Typed = (&'static str, Option<String>);

/// Which files show that an option was given.
struct Rule {
    option: &'static str,
    heeds: fn(kind: Kind, value: &str) -> bool,
    /// What is expected, and why other files do not do.
    expected: &'static str,
}

/// Of settings that make codes of light.
const PICTURE: &str = "a .jpg, .png or .tif to write: an .exr holds linear light, a .dng the numbers of the sensor";
/// Of settings of the development.
const DEVELOPED: &str = "a developed picture to write (.jpg, .png, .tif, .exr): a .dng holds the numbers of the sensor";

const RULES: [Rule; 12] = [
    Rule { option: "--quality", heeds: |k, _| k == Kind::Jpeg, expected: "a .jpg to write: other files lose nothing" },
    Rule { option: "--gain-map", heeds: |k, _| k == Kind::Jpeg, expected: "a .jpg to write: other files hold none" },
    Rule {
        option: "--bits",
        heeds: |k, bits| k == Kind::Png || k == if bits == "16" { Kind::Tiff } else { Kind::Jpeg },
        expected: "a .png to write: a .jpg always has 8 bits a channel, a .tif 16, an .exr floating-point numbers",
    },
    Rule { option: "--dng", heeds: |k, _| k == Kind::Dng, expected: "a .dng to write" },
    Rule { option: "--tone", heeds: |k, _| k.is_looked_at(), expected: PICTURE },
    Rule { option: "--lut", heeds: |k, _| k.is_looked_at(), expected: PICTURE },
    Rule { option: "--gamma", heeds: |k, _| k.is_looked_at(), expected: PICTURE },
    Rule { option: "--set", heeds: |k, s| if is_of_light(s) { k != Kind::Dng } else { k.is_looked_at() }, expected: PICTURE },
    Rule { option: "--preset", heeds: |k, _| k != Kind::Dng, expected: DEVELOPED },
    Rule { option: "--recipe", heeds: |k, _| k != Kind::Dng, expected: DEVELOPED },
    Rule { option: "--demosaic", heeds: |k, _| k != Kind::Dng, expected: DEVELOPED },
    Rule { option: "--exposure-ev", heeds: |k, _| k != Kind::Dng, expected: DEVELOPED },
];

/// Whether a setting (`name=value`) changes linear light, too: what `Recipe::linear_light` keeps.
fn is_of_light(setting: &str) -> bool {
    let name = setting.trim();
    !["tone.", "grade.", "lut.", "sharpen.", "output.encoding"].iter().any(|part| name.starts_with(part))
}

/// Refuses an option that none of the files to write heeds.
pub fn check(typed: impl IntoIterator<Item = Typed>, written: &[Kind]) -> anyhow::Result<()> {
    for (option, value) in typed {
        let Some(value) = value else { continue };
        let rule = RULES.iter().find(|rule| rule.option == option).expect("an option of the table");
        if !written.iter().any(|kind| (rule.heeds)(*kind, &value)) {
            let typed = format!("{option} {value}");
            return Err(UsageError(anyhow!("{}: expected {}", typed.trim_end(), rule.expected)).into());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_that_no_file_heeds_are_refused() {
        use Kind::*;
        for (option, value, heeding, others) in [
            ("--quality", "80", &[Jpeg][..], &[Png, Tiff, Exr, Dng][..]),
            ("--gain-map", "", &[Jpeg], &[Png, Tiff, Exr, Dng]),
            ("--bits", "16", &[Png, Tiff], &[Jpeg, Exr, Dng]),
            ("--bits", "8", &[Png, Jpeg], &[Tiff, Exr, Dng]),
            ("--dng", "packed", &[Dng], &[Jpeg, Png, Tiff, Exr]),
            ("--tone", "agx", &[Jpeg, Png, Tiff], &[Exr, Dng]),
            ("--set", "grade.contrast=2", &[Jpeg, Png, Tiff], &[Exr, Dng]),
            ("--set", "white.balance=D50", &[Jpeg, Png, Tiff, Exr], &[Dng]),
            ("--preset", "film", &[Jpeg, Png, Tiff, Exr], &[Dng]),
        ] {
            let check = |kinds: &[Kind]| check([(option, Some(value.to_owned()))], kinds);
            heeding.iter().for_each(|kind| check(&[Dng, *kind, Exr]).unwrap_or_else(|e| panic!("{option} {kind:?}: {e}")));
            for kind in others {
                let e = check(&[*kind]).expect_err(option).to_string();
                assert!(e.starts_with(format!("{option} {value}").trim_end()) && e.contains(": expected a"), "{kind:?}: {e}");
            }
            assert!(check(others).is_err() && check(&[]).is_err(), "{option}");
        }
        assert!(check([("--tone", None)], &[]).is_ok());
    }
}
