//! From a preview to the volume itself: what somebody has changed meanwhile is kept.

use supervol_scene::scene::{ImageSpec, Scene};

use crate::worker::Opened;

/// What is shown of a volume whose preview was shown before as `now`, and at first as `begun`.
///
/// Cameras, planes, solids and colours are where they were. The look is the volume's own, unless somebody has changed it.
pub(crate) fn carried(now: &Scene, begun: &Scene, preview_of: [u64; 3], opened: &Opened) -> Scene {
    let look = |scene: &Scene| Scene { camera: None, image: ImageSpec::default(), ..scene.clone() };
    if look(now) == look(begun) {
        return Scene { camera: now.camera.clone(), ..opened.scene.clone() };
    }
    let mut scene = now.clone();
    if let Some([low, high]) = &mut scene.clip.index_box {
        for a in 0..3 {
            low[a] = volume_index(low[a], preview_of[a]);
            high[a] = volume_index(high[a], preview_of[a]).min(opened.facts.dims.0[a] as f64 - 0.5);
        }
    }
    scene
}

/// The face of the volume's voxel that the face of a preview's voxel stands for: both hold the same voxels of the preview.
fn volume_index(face: f64, stride: u64) -> f64 {
    (face + 0.5) * stride as f64 - 0.5
}

#[cfg(test)]
mod tests {
    use super::volume_index;

    #[test]
    fn faces_hold_the_voxels_of_the_preview() {
        // Voxels 2 and 3 of one in four are the volume's 8 to 15.
        assert_eq!([volume_index(1.5, 4), volume_index(3.5, 4), volume_index(-0.5, 4)], [7.5, 15.5, -0.5]);
        assert_eq!(volume_index(6.5, 1), 6.5);
    }
}
