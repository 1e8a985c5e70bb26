//! Settings of a development: each is declared once, in the section of its step, with its default, its unit, what it may be, and why.

/// What a setting may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    /// A number from the first to the second.
    Number(f64, f64),
    /// So many numbers, each from the first to the second.
    Numbers(usize, f64, f64),
    /// Yes or no.
    Bool,
    /// One of these names.
    Names(&'static [&'static str]),
    /// Text.
    Text,
}

impl std::fmt::Display for Allowed {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Allowed::Number(low, high) => write!(f, "{low} to {high}"),
            Allowed::Numbers(n, low, high) => write!(f, "{n} numbers, each {low} to {high}"),
            Allowed::Bool => write!(f, "true or false"),
            Allowed::Names(names) => write!(f, "one of {}", names.join(", ")),
            Allowed::Text => write!(f, "text"),
        }
    }
}

/// What is to be known about a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Section and name, as in a recipe file.
    pub name: &'static str,
    /// Unit; empty of bare numbers.
    pub unit: &'static str,
    /// What it may be.
    pub allowed: Allowed,
    /// What it does, and why its default is what it is.
    pub why: &'static str,
}

/// A recipe that cannot be followed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {found}; expected {expected}")]
pub struct RecipeError {
    /// Name of the setting.
    pub place: String,
    /// What is there.
    pub found: String,
    /// What belongs there.
    pub expected: String,
}

/// A section of a recipe: `field: type = default, "unit", what it may be, "what it does"; ...`.
macro_rules! section {
    ($(#[$about:meta])* $name:ident $section:literal {
        $($field:ident: $type:ty = $default:expr, $unit:literal, $allowed:expr, $why:literal;)*
    }) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name { $(#[doc = $why] pub $field: $type,)* }

        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default,)* }
            }
        }

        impl $name {
            pub(crate) const SETTINGS: &'static [$crate::setting::Setting] = {
                use $crate::setting::Allowed::*;
                &[$($crate::setting::Setting {
                    name: concat!($section, ".", stringify!($field)),
                    unit: $unit,
                    allowed: $allowed,
                    why: $why,
                },)*]
            };
        }
    };
}

/// A choice by name.
macro_rules! names {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $variant:ident = $text:literal,)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name { $($(#[$doc])* #[serde(rename = $text)] $variant,)* }

        impl $name {
            pub(crate) const NAMES: &'static [&'static str] = &[$($text,)*];
        }
    };
}

pub(crate) use {names, section};
