//! Vectors and other lists of a fixed length, in square brackets.
use super::Length;
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// Three components in square brackets, `[x, y, z]`.
///
/// RON writes arrays of a fixed length as tuples, in round brackets; in a scene every vector is a list.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Triple<T>(pub [T; 3]);

/// A point: three lengths.
pub type Point = Triple<Length>;

impl<T> std::ops::Deref for Triple<T> {
    type Target = [T; 3];
    fn deref(&self) -> &[T; 3] {
        &self.0
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Triple<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        list::deserialize(deserializer).map(Triple)
    }
}

impl<T: Serialize> Serialize for Triple<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        list::serialize(&self.0, serializer)
    }
}

impl<T: Copy + Into<f64>> From<Triple<T>> for glam::DVec3 {
    fn from(t: Triple<T>) -> Self {
        glam::DVec3::from_array(t.0.map(Into::into))
    }
}

/// `#[serde(with = "list")]` for a `[T; N]` that is written in square brackets.
pub mod list {
    use super::*;

    struct V<T, const N: usize>(std::marker::PhantomData<T>);

    impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for V<T, N> {
        type Value = [T; N];
        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            write!(f, "a list of {N}")
        }
        fn visit_seq<A: de::SeqAccess<'de>>(self, mut items: A) -> Result<[T; N], A::Error> {
            let mut read = Vec::with_capacity(N);
            while read.len() < N {
                match items.next_element()? {
                    Some(item) => read.push(item),
                    None => return Err(de::Error::custom(format!("a list of {N} is needed, {} given", read.len()))),
                }
            }
            if items.next_element::<de::IgnoredAny>()?.is_some() {
                return Err(de::Error::custom(format!("a list of {N} is needed, more given")));
            }
            Ok(read.try_into().unwrap_or_else(|_| unreachable!("{N} items were read")))
        }
    }

    /// Reads a list of N.
    ///
    /// # Errors
    /// Anything but a list of N.
    pub fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(deserializer: D) -> Result<[T; N], D::Error> {
        deserializer.deserialize_any(V(std::marker::PhantomData))
    }

    /// Writes a list.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer, T: Serialize, const N: usize>(value: &[T; N], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(value)
    }
}

/// An array in square brackets, for use inside other types.
struct List<T, const N: usize>([T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for List<T, N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        list::deserialize(deserializer).map(List)
    }
}

impl<T: Serialize, const N: usize> Serialize for List<T, N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        list::serialize(&self.0, serializer)
    }
}

/// `#[serde(with = "lists")]` for a list of `[T; N]`.
pub mod lists {
    use super::*;

    /// Reads a list of lists of N.
    ///
    /// # Errors
    /// An entry that is not a list of N.
    pub fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(deserializer: D) -> Result<Vec<[T; N]>, D::Error> {
        Vec::<List<T, N>>::deserialize(deserializer).map(|v| v.into_iter().map(|t| t.0).collect())
    }

    /// Writes a list of lists.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer, T: Serialize + Copy, const N: usize>(value: &[[T; N]], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(value.iter().map(|t| List(*t)))
    }
}

/// `#[serde(with = "list_option")]` for an optional `[T; N]`.
pub mod list_option {
    use super::*;

    /// Reads a list of N if there is one.
    ///
    /// # Errors
    /// Anything but a list of N.
    pub fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
        deserializer: D,
    ) -> Result<Option<[T; N]>, D::Error> {
        Option::<List<T, N>>::deserialize(deserializer).map(|t| t.map(|t| t.0))
    }

    /// Writes a list if there is one.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer, T: Serialize + Copy, const N: usize>(value: &Option<[T; N]>, serializer: S) -> Result<S::Ok, S::Error> {
        value.map(List).serialize(serializer)
    }
}
