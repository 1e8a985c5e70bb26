//! What a section of the shot file is made of: settings that may be left out, and the macros that declare sections and flags at once.

use std::collections::BTreeMap;

/// A setting that may be left out.
pub trait Setting: Sized {
    /// Whether nothing is said.
    fn is_absent(&self) -> bool;

    /// Takes what another says, where it says something.
    fn override_with(&mut self, said: Self) {
        if !said.is_absent() {
            *self = said;
        }
    }
}

impl Setting for bool {
    fn is_absent(&self) -> bool {
        !self
    }
}

impl<T> Setting for Vec<T> {
    fn is_absent(&self) -> bool {
        self.is_empty()
    }
}

impl<K, V> Setting for BTreeMap<K, V> {
    fn is_absent(&self) -> bool {
        self.is_empty()
    }
}

impl<T: Value> Setting for Option<T> {
    fn is_absent(&self) -> bool {
        self.is_none()
    }

    fn override_with(&mut self, said: Self) {
        match (self, said) {
            (_, None) => {}
            (Some(value), Some(said)) => value.replace(said),
            (absent, said) => *absent = said,
        }
    }
}

/// What a setting says: of a section its parts count one by one, all else is replaced as a whole.
pub trait Value: Sized {
    /// Takes what another says.
    fn replace(&mut self, said: Self) {
        *self = said;
    }
}

/// A section of the shot file.
pub(super) trait Section {
    /// Names of its keys.
    const KEYS: &'static [&'static str];
}

macro_rules! values {
    ($($of:ty),* $(,)?) => { $(impl Value for $of {})* };
}

macro_rules! section {
    (
        $heading:literal:
        $(#[$about:meta])*
        pub struct $name:ident {
            $($(#[$field_about:meta])* pub $field:ident: $of:ty,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
        #[serde(default, deny_unknown_fields)]
        #[command(next_help_heading = $heading)]
        pub struct $name {
            $(
                $(#[$field_about])*
                #[serde(skip_serializing_if = "Setting::is_absent")]
                pub $field: $of,
            )*
        }

        impl Section for $name {
            const KEYS: &'static [&'static str] = &[$(stringify!($field)),*];
        }

        impl Setting for $name {
            fn is_absent(&self) -> bool {
                $(self.$field.is_absent())&&*
            }

            fn override_with(&mut self, said: Self) {
                $(self.$field.override_with(said.$field);)*
            }
        }

        impl Value for $name {
            fn replace(&mut self, said: Self) {
                self.override_with(said);
            }
        }
    };
}

pub(super) use {section, values};
