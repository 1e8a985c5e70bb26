//! What pixels see through: filters, and the arrays of them.

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

    /// A pattern by name or by its letters, rows separated by `/`: `RG/GB`, `quad`, `x-trans`, `mono`, `polarized`. `None` when rows are
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

    /// The letters, rows separated by `/`.
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

    /// How many of the four nearest neighbours of a pixel of each channel see each channel, on average over the pattern: `[own][neighbour]`.
    pub fn neighbours(&self) -> Vec<Vec<f64>> {
        let n = self.channel_count();
        let (mut counts, mut pixels) = (vec![vec![0.0; n]; n], vec![0.0; n]);
        let (rows, columns) = (self.rows(), self.columns);
        for row in 0..rows {
            for column in 0..columns {
                let own = self.channel_at(column, row);
                pixels[own] += 1.0;
                for (x, y) in [(column + 1, row), (column + columns - 1, row), (column, row + 1), (column, row + rows - 1)] {
                    counts[own][self.channel_at(x, y)] += 1.0;
                }
            }
        }
        counts.iter_mut().zip(pixels).for_each(|(counts, pixels)| counts.iter_mut().for_each(|count| *count /= pixels));
        counts
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
