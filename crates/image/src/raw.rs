//! What the sensor hands out: one number a pixel, and what it takes to make colours of them.

use crate::dng::opcode::Opcode;
use crate::{ExposureFacts, Raster};

/// What a pixel sees through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Filter {
    /// A red filter.
    Red,
    /// A green filter.
    Green,
    /// A blue filter.
    Blue,
    /// None: clear, or a monochrome sensor.
    Clear,
    /// A linear polariser whose axis is horizontal.
    Linear0,
    /// The same at 45°, counter-clockwise in the picture.
    Linear45,
    /// The same upright.
    Linear90,
    /// The same at 135°.
    Linear135,
}

impl Filter {
    /// All filters, in the order of channels.
    pub const ALL: [Filter; 8] = [
        Filter::Red,
        Filter::Green,
        Filter::Blue,
        Filter::Clear,
        Filter::Linear0,
        Filter::Linear45,
        Filter::Linear90,
        Filter::Linear135,
    ];

    /// Whether it is a colour filter.
    pub fn is_colored(self) -> bool {
        matches!(self, Filter::Red | Filter::Green | Filter::Blue)
    }

    /// Transmission axis of a polariser, degrees counter-clockwise from the horizontal in the picture; `None` of other filters.
    pub fn polarizer_deg(self) -> Option<f64> {
        match self {
            Filter::Linear0 => Some(0.0),
            Filter::Linear45 => Some(45.0),
            Filter::Linear90 => Some(90.0),
            Filter::Linear135 => Some(135.0),
            Filter::Red | Filter::Green | Filter::Blue | Filter::Clear => None,
        }
    }

    /// The letter of a filter: `R`, `G`, `B` or `W`; of polarisers `H` (horizontal), `D` (diagonal, 45°), `V` (vertical), `A` (antidiagonal, 135°).
    pub fn letter(self) -> char {
        match self {
            Filter::Red => 'R',
            Filter::Green => 'G',
            Filter::Blue => 'B',
            Filter::Clear => 'W',
            Filter::Linear0 => 'H',
            Filter::Linear45 => 'D',
            Filter::Linear90 => 'V',
            Filter::Linear135 => 'A',
        }
    }

    /// The filter of a letter; `C` (clear) is `W` too.
    pub fn from_letter(letter: char) -> Option<Filter> {
        match letter {
            'C' => Some(Filter::Clear),
            _ => Filter::ALL.into_iter().find(|f| f.letter() == letter),
        }
    }
}

/// A colour filter array: a rectangle of filters repeated over the sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cfa {
    columns: usize,
    cells: Vec<Filter>,
    /// Channel of each cell.
    channels: Vec<u8>,
    /// The filters of the channels.
    filters: Vec<Filter>,
    /// Whether the cells of one period are the samples of one pixel.
    all_channels: bool,
}

impl Cfa {
    /// Most cells a side of a pattern.
    pub const LARGEST_SIDE: usize = 16;

    /// Most different filters.
    pub const MOST_FILTERS: usize = 4;

    /// A pattern from its cells, row by row. `None` when they make no rectangle of at most [`Cfa::LARGEST_SIDE`] a side, or of more filters than
    /// [`Cfa::MOST_FILTERS`].
    pub fn new(columns: usize, cells: Vec<Filter>) -> Option<Self> {
        let fits = (1..=Self::LARGEST_SIDE).contains(&columns)
            && !cells.is_empty()
            && cells.len().is_multiple_of(columns)
            && cells.len() / columns <= Self::LARGEST_SIDE;
        if !fits {
            return None;
        }
        let filters: Vec<Filter> = Filter::ALL.into_iter().filter(|f| cells.contains(f)).collect();
        if filters.len() > Self::MOST_FILTERS {
            return None;
        }
        let channels = cells.iter().map(|c| filters.iter().position(|f| f == c).unwrap_or(0) as u8).collect();
        Some(Cfa { columns, cells, channels, filters, all_channels: false })
    }

    /// No filter anywhere.
    pub fn monochrome() -> Self {
        Cfa { columns: 1, cells: vec![Filter::Clear], channels: vec![0], filters: vec![Filter::Clear], all_channels: false }
    }

    /// No mosaic: every pixel has a red, a green and a blue sample, side by side in a row, as in a linear DNG. A row of such a raw image holds
    /// three numbers a pixel, so that whatever treats numbers by their channel needs not know.
    pub fn linear_rgb() -> Self {
        let cells = Filter::ALL[..3].to_vec();
        Cfa { columns: 3, filters: cells.clone(), cells, channels: vec![0, 1, 2], all_channels: true }
    }

    /// Whether every pixel has all channels: nothing is to be demosaiced.
    pub fn has_all_channels(&self) -> bool {
        self.all_channels
    }

    /// Numbers a pixel: 1 of a mosaic, the number of channels where every pixel has all.
    pub fn samples_per_pixel(&self) -> usize {
        if self.all_channels { self.columns } else { 1 }
    }

    /// A pattern by name or by its letters, rows parted by `/`: `RG/GB`, `quad`, `x-trans`, `mono`, `polarized`. `None` when rows are
    /// uneven or a letter is not one of R, G, B, W (or C), H, D, V, A.
    pub fn parse(text: &str) -> Option<Self> {
        let letters = match text.trim().to_lowercase().as_str() {
            "mono" | "monochrome" => "W".to_owned(),
            "bayer" => "RG/GB".into(),
            "quad" => "RRGG/RRGG/GGBB/GGBB".into(),
            // Source: Fujifilm, X-Trans CMOS; the phase in which most bodies read it.
            "x-trans" => "GGRGGB/GGBGGR/BRGRBG/GGBGGR/GGRGGB/RBGBRG".into(),
            // Source: Kodak (Compton & Hamilton), US 8139130, pattern 1 as used by RGBW sensors.
            "rgbw" => "WGWR/GWRW/WBWG/BWGW".into(),
            "rccc" => "RC/CC".into(),
            // Source: Sony, IMX250MZR: 90°, 45° over 135°, 0°.
            "polarized" => "VD/AH".into(),
            _ => text.trim().to_uppercase(),
        };
        let rows: Vec<&str> = letters.split('/').collect();
        let columns = rows[0].len();
        let cells: Option<Vec<Filter>> = letters.chars().filter(|c| *c != '/').map(Filter::from_letter).collect();
        (rows.iter().all(|r| r.len() == columns)).then(|| Self::new(columns, cells?)).flatten()
    }

    /// The letters, rows parted by `/`.
    pub fn letters(&self) -> String {
        let row = |r: &[Filter]| r.iter().map(|f| f.letter()).collect::<String>();
        self.cells.chunks(self.columns).map(row).collect::<Vec<_>>().join("/")
    }

    /// Columns of the pattern.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Rows of the pattern.
    pub fn rows(&self) -> usize {
        self.cells.len() / self.columns
    }

    /// Filters of the channels: what a channel's number stands for.
    pub fn filters(&self) -> &[Filter] {
        &self.filters
    }

    /// Number of channels.
    pub fn channel_count(&self) -> usize {
        self.filters.len()
    }

    /// Names of the channels, as bands of a focal plane are called: `R`, `G`, `B`, `W`, or `Y` of a monochrome sensor; `P0`, `P45`, `P90`, `P135` behind polarisers.
    pub fn channel_names(&self) -> Vec<&'static str> {
        if self.filters == [Filter::Clear] {
            return vec!["Y"];
        }
        let name = |f: &Filter| match f {
            Filter::Red => "R",
            Filter::Green => "G",
            Filter::Blue => "B",
            Filter::Clear => "W",
            Filter::Linear0 => "P0",
            Filter::Linear45 => "P45",
            Filter::Linear90 => "P90",
            Filter::Linear135 => "P135",
        };
        self.filters.iter().map(name).collect()
    }

    /// Whether all pixels see the same.
    pub fn is_monochrome(&self) -> bool {
        self.filters.len() == 1
    }

    /// Whether no pixel has a colour filter.
    pub fn is_colorless(&self) -> bool {
        !self.filters.iter().any(|f| f.is_colored())
    }

    /// Whether pixels see through polarisers.
    pub fn tells_polarization(&self) -> bool {
        self.filters.iter().any(|f| f.polarizer_deg().is_some())
    }

    /// Whether this is one of the four phases of R, G, G, B.
    pub fn is_bayer(&self) -> bool {
        let c = &self.cells;
        self.columns == 2
            && self.filters == Filter::ALL[..3]
            && c.len() == 4
            && c.iter().filter(|f| **f == Filter::Green).count() == 2
            && (c[0] == Filter::Green) == (c[3] == Filter::Green)
    }

    /// Channel of a pixel.
    #[inline]
    pub fn channel_at(&self, column: usize, row: usize) -> usize {
        self.channels[(row % self.rows()) * self.columns + column % self.columns] as usize
    }

    /// Channel of a place that may lie outside the picture, where the pattern goes on.
    #[inline]
    pub fn channel_beyond(&self, column: i64, row: i64) -> usize {
        self.channel_at(column.rem_euclid(self.columns as i64) as usize, row.rem_euclid(self.rows() as i64) as usize)
    }

    /// Filter of a pixel.
    pub fn filter_at(&self, column: usize, row: usize) -> Filter {
        self.filters[self.channel_at(column, row)]
    }
}

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

    /// The number of an illuminant of CIE.
    pub fn of_illuminant(name: &str) -> LightSource {
        LightSource(match name.to_uppercase().as_str() {
            "A" => 17,
            "D55" => 20,
            "D65" => 21,
            "D75" => 22,
            "D50" => 23,
            "FL2" => 14,
            "FL7" => 12,
            "FL8" => 13,
            "FL11" => 15,
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
            15 => 4000.0,
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
