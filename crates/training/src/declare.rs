//! How settings are declared: each fact about one stands at its field, and nowhere else.

/// Declares a table of settings: of each its meaning, kind and default, and the rule that it has to keep, if there is
/// one. Tables within it come last. Gives the structure, its defaults, its [`Setting`](crate::Setting)s by their full
/// names, and a check of all rules.
macro_rules! settings {
    (
        $(#[$about:meta])*
        pub struct $name:ident in $prefix:literal {
            $(
                $(#[doc = $doc:literal])*
                $(#[serde($($serde:tt)*)])?
                pub $key:ident: $kind:ty = $default:expr $(, $rule:expr)?;
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
            /// What is known of each setting, in order.
            pub(crate) fn described() -> Vec<$crate::Setting> {
                [
                    vec![$({
                        let rule: Option<&$crate::setting::Rule> = None;
                        $(let rule = rule.or(Some(&$rule));)?
                        let name = concat!($prefix, stringify!($key));
                        $crate::Setting::new::<$kind>(name, concat!($($doc, "\n"),*), rule)
                    }),*],
                    $($(<$of>::described(),)*)?
                ]
                .concat()
            }

            /// Checks that every setting keeps its rule.
            ///
            /// # Errors
            /// If one does not; the message says what it must be.
            pub(crate) fn check_rules(&self) -> Result<(), $crate::TrainingError> {
                $($($crate::setting::check(concat!($prefix, stringify!($key)), &self.$key, &$rule)?;)?)*
                $($(self.$table.check_rules()?;)*)?
                Ok(())
            }
        }
    };
}

/// Declares names that a setting may be: of each its meaning and its spelling.
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

        impl $crate::setting::Kind for $name {
            fn wanted() -> String {
                $crate::setting::one_of([$($spelling),*])
            }

            fn choices() -> &'static [$crate::Choice] {
                &[$($crate::Choice { name: $spelling, meaning: concat!($($doc, "\n"),*) }),*]
            }

            fn reads(value: toml::Spanned<toml::de::DeValue<'_>>) -> bool {
                $crate::setting::reads_as::<$name>(value)
            }
        }
    };
}

pub(crate) use {choice, settings};
