//! Boxes of voxels, and the transform between index and world space. Only this module adds the half voxel.
//!
//! Index space: voxel (i, j, k) is a sample at the point (i, j, k); a grid of n voxels spans `[-1/2, n-1/2]`.
//! World space: `x = origin + D * (spacing .* p)` for the index point p (RENDERING-MODEL, section 1).
//! Between levels: on a halved axis the coarse point p lies at the fine point `2p + 1/2`.

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::BrickLayout;

/// Half a voxel: the distance from a voxel's sample point to the face of the cell it owns.
pub const HALF_VOXEL: f64 = 0.5;

/// Number of voxels along x, y, z; each at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Dims(pub [u64; 3]);

impl Dims {
    /// Largest number of voxels along one axis: [`crate::BrickKey`] can address as many with the largest bricks.
    /// Smaller bricks address fewer ([`crate::BrickLayout::voxels_limit`]); their pyramid refuses larger grids.
    pub const LIMIT: u64 = BrickLayout::LARGEST.voxels_limit();

    /// Number of voxels, or `None` if it does not fit 64 bits.
    #[must_use]
    pub fn voxels(self) -> Option<u64> {
        self.0[0].checked_mul(self.0[1])?.checked_mul(self.0[2])
    }

    /// Size of the grid in bytes for this voxel type, or `None` if it does not fit 64 bits.
    #[must_use]
    pub fn bytes(self, voxel_type: crate::VoxelType) -> Option<u64> {
        self.voxels()?.checked_mul(voxel_type.bytes() as u64)
    }

    /// The box of all voxels.
    #[must_use]
    pub fn full_box(self) -> VoxelBox {
        VoxelBox { start: [0; 3], end: self.0 }
    }

    /// Whether each axis has 1 to [`Self::LIMIT`] voxels.
    #[must_use]
    pub fn is_valid(self) -> bool {
        self.0.iter().all(|&n| (1..=Self::LIMIT).contains(&n))
    }
}

impl std::fmt::Display for Dims {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {} x {}", self.0[0], self.0[1], self.0[2])
    }
}

/// Half-open box of voxels: contains `start`, excludes `end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct VoxelBox {
    /// First voxel on each axis.
    pub start: [u64; 3],
    /// One past the last voxel on each axis.
    pub end: [u64; 3],
}

impl VoxelBox {
    /// Voxels on each axis.
    ///
    /// # Panics
    /// If `start` exceeds `end` on an axis, or an axis exceeds the address space.
    #[must_use]
    pub fn extent(self) -> [usize; 3] {
        std::array::from_fn(|a| {
            assert!(self.start[a] <= self.end[a], "box {self:?} is inside out on axis {a}");
            usize::try_from(self.end[a] - self.start[a]).expect("an axis of a box fits the address space")
        })
    }

    /// Number of voxels.
    #[must_use]
    pub fn voxels(self) -> usize {
        self.extent().iter().product()
    }

    /// Intersection of both boxes. If it is empty, `start == end` on some axis.
    #[must_use]
    pub fn intersect(self, other: Self) -> Self {
        let start = std::array::from_fn(|a| self.start[a].max(other.start[a]));
        let end = std::array::from_fn(|a| self.end[a].min(other.end[a]).max(start[a]));
        Self { start, end }
    }

    /// The box grown by `margin` voxels on every side, then clipped to a grid.
    #[must_use]
    pub fn grown(self, margin: u64, grid: Dims) -> Self {
        Self { start: self.start.map(|s| s.saturating_sub(margin)), end: self.end.map(|e| e.saturating_add(margin)) }
            .intersect(grid.full_box())
    }

    /// Whether the voxel lies in the box.
    #[must_use]
    pub fn contains(self, voxel: [u64; 3]) -> bool {
        (0..3).all(|a| (self.start[a]..self.end[a]).contains(&voxel[a]))
    }
}

/// Placement of the grid in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Geometry {
    /// World distance between neighbouring voxels along x, y, z; positive.
    pub spacing: [f64; 3],
    /// World position of voxel (0, 0, 0).
    pub origin: [f64; 3],
    /// Row-major 3x3 matrix D; its columns are the world directions of the axes.
    pub direction: [f64; 9],
}

impl Geometry {
    /// Spacing 1, origin 0, grid axes parallel to the world axes.
    pub const IDENTITY: Self =
        Self { spacing: [1.0; 3], origin: [0.0; 3], direction: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };

    /// Matrix from index offsets to world offsets: D times the diagonal matrix of the spacings.
    #[must_use]
    pub fn linear(&self) -> DMat3 {
        let columns = DMat3::from_cols_array(&self.direction).transpose();
        columns * DMat3::from_diagonal(DVec3::from_array(self.spacing))
    }

    /// The transform from index points to world points.
    #[must_use]
    pub fn world_from_index(&self) -> DAffine3 {
        DAffine3::from_mat3_translation(self.linear(), DVec3::from_array(self.origin))
    }

    /// The transform from world points to index points.
    #[must_use]
    pub fn index_from_world(&self) -> DAffine3 {
        self.world_from_index().inverse()
    }

    /// Matrix from an index-space gradient to a world-space gradient: the inverse transpose of [`Self::linear`].
    #[must_use]
    pub fn world_from_index_gradient(&self) -> DMat3 {
        self.linear().inverse().transpose()
    }

    /// The smallest of the three spacings, world units.
    #[must_use]
    pub fn smallest_spacing(&self) -> f64 {
        self.spacing.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Whether the axes x, y, z form a left-handed system. Such a grid is valid: its voxels keep their world positions.
    #[must_use]
    pub fn is_left_handed(&self) -> bool {
        DMat3::from_cols_array(&self.direction).determinant() < 0.0
    }

    /// Description of the first invalid number, or `None`. Spacings must be positive and finite, the matrix invertible.
    #[must_use]
    pub fn defect(&self) -> Option<String> {
        if self.spacing.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
            return Some(format!("spacing {:?} is not positive and finite", self.spacing));
        }
        if self.origin.iter().chain(&self.direction).any(|v| !v.is_finite()) {
            return Some(format!("origin {:?} or direction {:?} is not finite", self.origin, self.direction));
        }
        let determinant = DMat3::from_cols_array(&self.direction).determinant();
        (determinant.abs() < 1e-9).then(|| format!("direction {:?} is singular", self.direction))
    }
}

/// Meaning of the world axes, if the file states it. Both spaces are right-handed. A reader converts files of
/// left-handed spaces, so that no volume is drawn mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum WorldSpace {
    /// The file states no space.
    #[default]
    Unknown,
    /// Patient space: x to the right, y to the front, z to the head (NIfTI, many NRRD files).
    RightAnteriorSuperior,
    /// Patient space: x to the left, y to the back, z to the head (DICOM, ITK).
    LeftPosteriorSuperior,
}

impl WorldSpace {
    /// Name of the space in NRRD's spelling; empty for [`Self::Unknown`].
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Unknown => "",
            Self::RightAnteriorSuperior => "right-anterior-superior",
            Self::LeftPosteriorSuperior => "left-posterior-superior",
        }
    }

    /// The space of a name; [`Self::Unknown`] for any other.
    #[must_use]
    pub fn from_name(name: &str) -> Self {
        let known = [Self::RightAnteriorSuperior, Self::LeftPosteriorSuperior];
        known.into_iter().find(|space| space.name() == name).unwrap_or_default()
    }
}
