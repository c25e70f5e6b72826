//! Integer combinations of the period vectors: which copy of a filament a record looks at.
use glam::DVec3;

/// Largest multiple of a period vector that is looked at.
const REACH: i32 = 2;
const BASE: u32 = (2 * REACH + 1) as u32;

/// Number of an image: the digits of its multiples, shifted to be positive.
pub type Image = u8;

/// The images of a model with up to three period vectors.
#[derive(Clone, Debug, Default)]
pub struct Images {
    /// Rows of the dummy nodes that carry the period vectors.
    pub dummies: Vec<u32>,
}

impl Images {
    /// Number of images, the model itself included.
    pub fn count(&self) -> usize {
        BASE.pow(self.dummies.len() as u32) as usize
    }

    /// The model itself.
    pub fn zero(&self) -> Image {
        // (count - 1) / 2 for up to three period vectors: asked for each record.
        [0, 2, 12, 62][self.dummies.len()]
    }

    /// Multiple of each period vector.
    pub fn multiples(&self, image: Image) -> [i32; 3] {
        let mut rest = u32::from(image);
        let mut k = [0; 3];
        for k in k.iter_mut().take(self.dummies.len()) {
            *k = (rest % BASE) as i32 - REACH;
            rest /= BASE;
        }
        k
    }

    /// The image with these multiples, if it is within reach.
    pub fn of(&self, multiples: [i32; 3]) -> Option<Image> {
        let mut number = 0;
        for d in (0..self.dummies.len()).rev() {
            if multiples[d].abs() > REACH {
                return None;
            }
            number = number * BASE + (multiples[d] + REACH) as u32;
        }
        Some(number as Image)
    }

    /// The opposite image.
    pub fn negative(&self, image: Image) -> Image {
        (self.count() - 1 - image as usize) as Image
    }

    /// The image reached by going through both, if it is within reach.
    pub fn sum(&self, a: Image, b: Image) -> Option<Image> {
        if b == self.zero() {
            return Some(a);
        }
        let (a, b) = (self.multiples(a), self.multiples(b));
        self.of(std::array::from_fn(|d| a[d] + b[d]))
    }

    /// One of every pair of opposite images.
    pub fn half(&self) -> std::ops::Range<usize> {
        self.zero() as usize + 1..self.count()
    }

    /// Writes the vectors of all images from the vectors of the dummy nodes.
    pub fn vectors(&self, of_row: impl Fn(usize) -> DVec3, out: &mut Vec<DVec3>) {
        out.clear();
        for i in 0..self.count() {
            let k = self.multiples(i as Image);
            let mut sum = DVec3::ZERO;
            for (d, row) in self.dummies.iter().enumerate() {
                sum += of_row(*row as usize) * f64::from(k[d]);
            }
            out.push(sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_add_like_integers() {
        let images = Images { dummies: vec![4, 9] };
        let z = images.zero();
        assert_eq!(images.multiples(z), [0, 0, 0]);
        for a in 0..images.count() as Image {
            assert_eq!(images.of(images.multiples(a)), Some(a));
            assert_eq!(images.sum(a, images.negative(a)), Some(z));
        }
        assert_eq!(images.sum(images.of([2, 0, 0]).unwrap(), images.of([1, 0, 0]).unwrap()), None);
        assert_eq!(Images::default().count(), 1);
        assert!(Images::default().half().is_empty());
    }
}
