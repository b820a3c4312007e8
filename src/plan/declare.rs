//! The macro that declares a table of a plan. The field is the only place that states a key's
//! description, type, default and allowed values.

/// Declares a table: for each field its description, type, default and allowed values. A field
/// without allowed values is not a key. `=>` names the type by which a value is checked, if it is
/// not that of the field; `as` names the key, if it is not that of the field.
///
/// Generates the structure, its `Default`, and a list of [`Key`](crate::plan::Key)s in order of
/// declaration, which is also the order of the fields in TOML.
macro_rules! plan_table {
    (
        $(#[$about:meta])*
        pub struct $name:ident in $table:literal {
            $(
                $(#[doc = $doc:literal])*
                $(#[serde($($serde:tt)*)])?
                pub $field:ident $(as $spelled:literal)?: $kind:ty = $default:expr
                    $(, $allowed:expr $(=> $read:ty)?)?;
            )*
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
        pub struct $name {
            $(
                $(#[doc = $doc])*
                $(#[serde($($serde)*)])?
                $(#[serde(rename = $spelled)])?
                pub $field: $kind,
            )*
        }

        impl Default for $name {
            fn default() -> $name {
                $name { $($field: $default,)* }
            }
        }

        impl $name {
            /// Returns the keys of the table, in order of declaration.
            pub(crate) fn described() -> Vec<$crate::plan::Key> {
                let defaults = toml::Table::try_from($name::default()).unwrap_or_default();
                let mut keys: Vec<$crate::plan::Key> = Vec::new();
                $(
                    let key = None;
                    $(let key = key.or(Some(
                        $crate::plan::keys::key::<$crate::plan::declare::read_type!($($read)?; $kind)>($allowed),
                    ));)?
                    let field = [$($spelled,)? stringify!($field)][0];
                    keys.extend(key.map(|key: $crate::plan::Key| key.named(field, concat!($($doc, "\n"),*))));
                )*
                keys.into_iter().map(|key| key.in_table($table, &defaults)).collect()
            }
        }
    };
}

/// The type by which a value is checked.
macro_rules! read_type {
    (; $kind:ty) => {
        $kind
    };
    ($read:ty; $kind:ty) => {
        $read
    };
}

pub(crate) use {plan_table, read_type};
