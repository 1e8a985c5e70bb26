//! What an optimisation changes and what it wants: variables within bounds, and the operands of the merit.

use crate::dual::Number;
use crate::tolerance::Direction;

/// What may change. Surfaces are counted from 0 here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Freedom {
    /// Curvature, 1/mm.
    Curvature {
        /// Which surface.
        surface: usize,
    },
    /// Gap after a surface, mm; after the last, the place of the film.
    Gap {
        /// Which surface.
        surface: usize,
    },
    /// Conic constant.
    Conic {
        /// Which surface.
        surface: usize,
    },
    /// Coefficient of a power of the height, mm¹⁻ᵖ.
    Asphere {
        /// Which surface.
        surface: usize,
        /// Which power.
        power: usize,
    },
    /// Index at d of what follows a surface; its dispersion stays.
    Index {
        /// Which surface.
        surface: usize,
    },
}

/// A variable with its bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// What changes.
    pub freedom: Freedom,
    /// Smallest and largest value.
    pub bounds: [f64; 2],
}

impl Variable {
    /// What it is called: "curvature of surface 3".
    pub fn name(&self) -> String {
        match self.freedom {
            Freedom::Curvature { surface } => format!("curvature of surface {}", surface + 1),
            Freedom::Gap { surface } => format!("gap after surface {}", surface + 1),
            Freedom::Conic { surface } => format!("conic constant of surface {}", surface + 1),
            Freedom::Asphere { surface, power } => format!("asphere {power} of surface {}", surface + 1),
            Freedom::Index { surface } => format!("index after surface {}", surface + 1),
        }
    }
}

/// Kinds of operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum OperandKind {
    /// RMS spot of all wavelengths, µm.
    Spot,
    /// RMS wavefront without tilt at the reference wavelength, waves.
    Wavefront,
    /// Distortion against f tan θ, with f the target of the efl operand, or the lens's own without; per cent.
    Distortion,
    /// Angle of the chief ray on the film, degrees from the axis.
    ChiefAngle,
    /// Effective focal length, mm.
    Efl,
    /// From the last vertex to the paraxial focus, mm.
    Bfl,
    /// From the first vertex to the film, mm.
    Length,
    /// Gap after a surface on the axis, mm.
    Thickness,
    /// The same at the smaller rim of its two surfaces, mm.
    Edge,
    /// Contrast of all wavelengths at a frequency, 0 to 1: the transfer function of the rays times that of a perfect lens.
    Mtf,
}

impl OperandKind {
    pub(super) const NAMES: [&str; 10] =
        ["spot", "wavefront", "distortion", "chief_angle", "efl", "bfl", "length", "thickness", "edge", "mtf"];
    pub(super) const ALL: [OperandKind; 10] = [
        OperandKind::Spot,
        OperandKind::Wavefront,
        OperandKind::Distortion,
        OperandKind::ChiefAngle,
        OperandKind::Efl,
        OperandKind::Bfl,
        OperandKind::Length,
        OperandKind::Thickness,
        OperandKind::Edge,
        OperandKind::Mtf,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        OperandKind::NAMES[self as usize]
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            OperandKind::Spot => "µm",
            OperandKind::Wavefront => "waves",
            OperandKind::Distortion => "%",
            OperandKind::ChiefAngle => "°",
            OperandKind::Mtf => "",
            _ => "mm",
        }
    }

    pub(super) fn of_field(self) -> bool {
        matches!(
            self,
            OperandKind::Spot | OperandKind::Wavefront | OperandKind::Distortion | OperandKind::ChiefAngle | OperandKind::Mtf
        )
    }

    pub(super) fn of_surface(self) -> bool {
        matches!(self, OperandKind::Thickness | OperandKind::Edge)
    }
}

/// What is wanted of a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// This value.
    Target(f64),
    /// A value within these bounds.
    Within([f64; 2]),
}

/// One term of the merit.
#[derive(Clone, Debug, PartialEq)]
pub struct Operand {
    /// Which value.
    pub kind: OperandKind,
    /// Number of the field, of what depends on it.
    pub field: Option<usize>,
    /// Number of the surface (0 the first), of what depends on it.
    pub surface: Option<usize>,
    /// Frequency (cycles/mm) and direction of a contrast.
    pub detail: Option<(f64, Direction)>,
    /// What is wanted.
    pub wanted: Wanted,
    /// Factor of its square.
    pub weight: f64,
}

impl Operand {
    /// How far a value is from what is wanted.
    pub(super) fn error<N: Number>(&self, value: N) -> N {
        let edge = match self.wanted {
            Wanted::Target(t) => t,
            Wanted::Within([low, high]) if (low..=high).contains(&value.value()) => return value.scaled(0.0),
            Wanted::Within([low, _]) if value.value() < low => low,
            Wanted::Within([_, high]) => high,
        };
        value - N::constant(edge)
    }

    /// What it is called: "spot, field 10°".
    pub fn name(&self, fields_deg: &[f64]) -> String {
        let mut name = self.kind.name().to_owned();
        if let Some((frequency, direction)) = self.detail {
            name += &format!(" {frequency}/mm {}", direction.name());
        }
        if let Some(f) = self.field {
            name += &format!(", field {}°", fields_deg[f]);
        }
        if let Some(s) = self.surface {
            name += &format!(" after surface {}", s + 1);
        }
        name
    }
}
