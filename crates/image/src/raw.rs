//! What the sensor hands out: one number a pixel, and what it takes to make colours of them.

pub use crate::cfa::{Cfa, Filter};

use crate::dng::opcode::Opcode;
use crate::{ExposureFacts, Raster};

/// What a camera's colours mean under one light.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorCalibration {
    /// The light, as EXIF LightSource.
    pub light: LightSource,
    /// Camera signals (rows) from XYZ, as DNG's ColorMatrix.
    pub camera_from_xyz: Vec<[f64; 3]>,
    /// XYZ under D50 from a white-balanced camera signal, a column a channel, as DNG's ForwardMatrix.
    pub xyz_d50_from_balanced: Vec<[f64; 3]>,
}

/// How much the first of a body's calibrations counts in light of a colour temperature, 0 to 1; `None` with fewer than two that have one of their own. Source: DNG 1.6, chapter 6,
/// "Mapping camera color space to CIE XYZ space": by the reciprocal of the temperature.
pub fn fraction_of_first(calibrations: &[ColorCalibration], kelvin: f64) -> Option<f64> {
    let [first, .., last] = calibrations else { return None };
    let (warm, cool) = (first.light.kelvin()?, last.light.kelvin()?);
    (warm != cool).then(|| ((1.0 / kelvin - 1.0 / cool) / (1.0 / warm - 1.0 / cool)).clamp(0.0, 1.0))
}

/// Rows of the colour matrix in light of a colour temperature, one a channel, between two calibrations; `None` without any.
pub fn camera_from_xyz(calibrations: &[ColorCalibration], kelvin: f64) -> Option<Vec<[f64; 3]>> {
    let last = &calibrations.last()?.camera_from_xyz;
    let Some(s) = fraction_of_first(calibrations, kelvin) else { return Some(last.clone()) };
    let between = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|k| a[k] * s + b[k] * (1.0 - s));
    Some(calibrations[0].camera_from_xyz.iter().zip(last).map(between).collect())
}

/// Factor from fractions of saturation to light of the scene in which metered grey is 18 %: saturation-based speeds put it at 10/78 of saturation (ISO 12232). DNG's `BaselineExposure`
/// counts from fractions of saturation, [`RawHeader::baseline_ev`] from there.
pub const GREY_GAIN: f64 = 0.18 * 78.0 / 10.0;

/// Kinds of light by their numbers in EXIF (tag LightSource, EXIF 2.32 table 4.6.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightSource(pub u16);

impl LightSource {
    /// Standard illuminant A.
    pub const A: LightSource = LightSource(17);
    /// D65.
    pub const D65: LightSource = LightSource(21);
    /// Some other light.
    pub const OTHER: LightSource = LightSource(255);

    /// The EXIF number of a CIE illuminant by its name (`D65`, `FL2` ...), or of a balance by its own (`daylight`, `shade` ...); [`LightSource::OTHER`] of any other.
    pub fn of_illuminant(name: &str) -> LightSource {
        LightSource(match name.to_uppercase().as_str() {
            "DAYLIGHT" => 1,
            "FLUORESCENT" => 2,
            "TUNGSTEN" => 3,
            "FLASH" => 4,
            "CLOUDY" => 10,
            "SHADE" => 11,
            "A" => 17,
            "D55" => 20,
            "D65" => 21,
            "D75" => 22,
            "D50" => 23,
            // By their colour temperatures: daylight 5700 to 7100 K, day white 4600 to 5500, cool white 3800 to 4500, white 3250 to 3800, warm white 2600 to 3250.
            "FL1" | "FL5" | "FL7" => 12,
            "FL8" | "FL10" => 13,
            "FL2" | "FL6" | "FL9" | "FL11" => 14,
            "FL3" => 15,
            "FL4" | "FL12" => 16,
            _ => 255,
        })
    }

    /// Correlated colour temperature, K, of the lights that matrices are made for. Source: CIE 15; `None` for others.
    pub fn kelvin(self) -> Option<f64> {
        Some(match self.0 {
            17 => 2856.0,
            20 => 5503.0,
            21 => 6504.0,
            22 => 7504.0,
            23 => 5003.0,
            14 => 4230.0,
            12 => 6500.0,
            13 => 5000.0,
            15 => 3450.0,
            // Daylight, fine weather, flash; cloudy; shade; tungsten; fluorescent; warm white; standard lights B and C; ISO studio tungsten: as
            // Adobe's DNG SDK takes them.
            1 | 4 | 9 => 5500.0,
            10 => 6500.0,
            11 => 7500.0,
            3 => 2850.0,
            2 => 4150.0,
            16 => 2925.0,
            18 => 4874.0,
            19 => 6774.0,
            24 => 3200.0,
            _ => return None,
        })
    }
}

/// All of a raw photograph but its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct RawHeader {
    /// Which channel each pixel saw.
    pub cfa: Cfa,
    /// Bits of the converter that made the numbers.
    pub bits: u32,
    /// DN of no light.
    pub black_level: f64,
    /// DN at which pixels are saturated.
    pub white_level: f64,
    /// Camera signals of a neutral surface in the light of the shot, a channel each, largest 1.
    pub as_shot_neutral: Vec<f64>,
    /// Calibrations, the warmest light first; none of a monochrome sensor.
    pub calibrations: Vec<ColorCalibration>,
    /// What the maker brightens by, EV, as DNG's BaselineExposure.
    pub baseline_ev: f64,
    /// What is shown of the mosaic, and how it is held.
    pub framing: Framing,
    /// What is still to be corrected once the picture is demosaiced: opcode list 3 of a DNG, with one warp at most. Places are in pixels of
    /// [`RawImage::size`].
    pub opcodes: Vec<Opcode>,
    /// What the reader of the file had to leave out or assume, for the user.
    pub warnings: Vec<String>,
    /// Noise of each channel: the variance of (DN − black) / (white − black) = x is `[0]`·x + `[1]`, as DNG's NoiseProfile.
    pub noise: Vec<[f64; 2]>,
    /// How it was made.
    pub facts: ExposureFacts,
}

/// What is shown of a mosaic, and how it is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// Left, top, width, height in numbers of the mosaic's rows and in rows; all of it without.
    pub crop: Option<[usize; 4]>,
    /// How it is turned.
    pub orientation: Orientation,
    /// Pixels of the picture for one of the mosaic, across and down, before it is turned: 1 where pixels are square. DNG's DefaultScale.
    pub scale: [f64; 2],
}

impl Default for Framing {
    fn default() -> Self {
        Framing { crop: None, orientation: Orientation::default(), scale: [1.0; 2] }
    }
}

/// How a picture is turned: EXIF's tag Orientation, 1 to 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orientation(u8);

impl Default for Orientation {
    fn default() -> Self {
        Orientation(1)
    }
}

impl Orientation {
    /// From the number of EXIF; others are upright.
    pub fn from_exif(number: u16) -> Self {
        Orientation(if (1..=8).contains(&number) { number as u8 } else { 1 })
    }

    /// Whether columns and rows change places (before anything is mirrored).
    pub fn transposes(self) -> bool {
        self.0 >= 5
    }

    /// Whether the stored picture is mirrored left to right, and top to bottom, on the way to the shown one (after transposing).
    pub fn mirrors(self) -> [bool; 2] {
        match self.0 {
            2 => [true, false],
            3 => [true, true],
            4 => [false, true],
            // 5: transposed; 6: turned to the right; 7: transposed about the other diagonal; 8: turned to the left.
            6 => [true, false],
            7 => [true, true],
            8 => [false, true],
            _ => [false, false],
        }
    }
}

/// A raw photograph, in digital numbers (DN).
#[derive(Clone, Debug, PartialEq)]
pub struct RawImage {
    /// DN of each pixel; where every pixel has all channels ([`Cfa::has_all_channels`]), its samples side by side: a row is as many times as wide.
    pub mosaic: Raster<u16>,
    /// All else.
    pub header: RawHeader,
}

impl RawImage {
    /// Pixels a row, and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.mosaic.width / self.header.cfa.samples_per_pixel(), self.mosaic.height]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bayer_letters_name_the_four_pixels() {
        let cfa = Cfa::parse("GB/RG").unwrap();
        assert_eq!([(0, 0), (1, 0), (0, 1), (3, 3)].map(|(c, r)| cfa.channel_at(c, r)), [1, 2, 0, 1]);
        assert!(cfa.is_bayer() && cfa.letters() == "GB/RG");
        for bad in ["RG/G", "RX/GB", "", "/", "RGRGRGRGRGRGRGRGR"] {
            assert_eq!(Cfa::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn other_patterns_have_their_channels() {
        let names = |p: &str| Cfa::parse(p).unwrap().channel_names().join("");
        assert_eq!(
            [names("mono"), names("x-trans"), names("quad"), names("rgbw"), names("rccc")],
            ["Y", "RGB", "RGB", "RGBW", "RW"]
        );
        let xtrans = Cfa::parse("x-trans").unwrap();
        let count = |f: Filter| (0..36).filter(|i| xtrans.filter_at(i % 6, i / 6) == f).count();
        assert_eq!([count(Filter::Red), count(Filter::Green), count(Filter::Blue)], [8, 20, 8]);
        assert!(!xtrans.is_bayer() && !Cfa::parse("RRGG/RRGG/GGBB/GGBB").unwrap().is_bayer());
    }
}
