//! Macros that declare settings. The field is the only place that states a setting's description,
//! default and constraint.

/// Declares a table of settings: for each field its description, type, default and optional
/// constraint, then nested tables.
///
/// Generates the structure, its `Default`, a list of [`Setting`](crate::Setting)s with full names,
/// and a check of all constraints.
macro_rules! settings {
    (
        $(#[$about:meta])*
        pub struct $name:ident in $prefix:literal {
            $(
                $(#[doc = $doc:literal])*
                $(#[serde($($serde:tt)*)])?
                pub $key:ident: $kind:ty = $default:expr $(, $constraint:expr)?;
            )*
        }
        $(tables {
            $(
                $(#[doc = $table_doc:literal])*
                pub $table:ident: $of:ty = $table_default:expr;
            )*
        })?
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $(
                $(#[doc = $doc])*
                $(#[serde($($serde)*)])?
                pub $key: $kind,
            )*
            $($($(#[doc = $table_doc])* pub $table: $of,)*)?
        }

        impl Default for $name {
            fn default() -> $name {
                $name {
                    $($key: $default,)*
                    $($($table: $table_default,)*)?
                }
            }
        }

        impl $name {
            /// Returns the facts about each setting, in order of declaration.
            pub(crate) fn described() -> Vec<$crate::Setting> {
                [
                    vec![$({
                        let constraint: Option<&$crate::settings::setting::Constraint> = None;
                        $(let constraint = constraint.or(Some(&$constraint));)?
                        let name = concat!($prefix, stringify!($key));
                        $crate::Setting::new::<$kind>(name, concat!($($doc, "\n"),*), constraint)
                    }),*],
                    $($(<$of>::described(),)*)?
                ]
                .concat()
            }

            /// Checks the constraint of every setting.
            ///
            /// # Errors
            /// If a value violates its constraint.
            pub(crate) fn check_constraints(&self) -> Result<(), $crate::TrainingError> {
                $($(
                    $crate::settings::setting::check(concat!($prefix, stringify!($key)), &self.$key, &$constraint)?;
                )?)*
                $($(self.$table.check_constraints()?;)*)?
                Ok(())
            }
        }
    };
}

/// Declares an enumerated setting: for each variant its description and its name in a settings
/// file.
macro_rules! choice {
    (
        $(#[$about:meta])*
        pub enum $name:ident {
            $($(#[doc = $doc:literal])* $variant:ident = $spelling:literal,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name {
            $($(#[doc = $doc])* #[serde(rename = $spelling)] $variant,)*
        }

        impl $crate::settings::setting::SettingKind for $name {
            fn allowed() -> String {
                $crate::settings::setting::one_of([$($spelling),*])
            }

            fn choices() -> &'static [$crate::Choice] {
                &[$($crate::Choice { name: $spelling, description: concat!($($doc, "\n"),*) }),*]
            }

            fn reads(value: toml::Spanned<toml::de::DeValue<'_>>) -> bool {
                $crate::settings::setting::reads_as::<$name>(value)
            }
        }
    };
}

pub(crate) use {choice, settings};
