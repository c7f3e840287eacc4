//! Transition from a preview to the volume itself: keeps the user's changes.

use supervol_scene::scene::{ImageSpec, Scene};

use crate::worker::OpenVolume;

/// The scene of a volume that replaces its preview. `now` is the preview's present scene, `begun` its first one.
///
/// Camera, planes, solids and colours keep their positions. The look is the volume's own unless the user has changed
/// it. `preview_of` is the distance of the preview's voxels along each axis, in voxels of the volume.
pub(crate) fn carry_over(now: &Scene, begun: &Scene, preview_of: [u64; 3], opened: &OpenVolume) -> Scene {
    let look = |scene: &Scene| Scene { camera: None, image: ImageSpec::default(), ..scene.clone() };
    if look(now) == look(begun) {
        return Scene { camera: now.camera.clone(), ..opened.scene.clone() };
    }
    let mut scene = now.clone();
    if let Some([low, high]) = &mut scene.clip.index_box {
        for a in 0..3 {
            low[a] = volume_index(low[a], preview_of[a]);
            high[a] = volume_index(high[a], preview_of[a]).min(opened.facts().dims.0[a] as f64 - 0.5);
        }
    }
    scene
}

/// Index coordinate in the volume of a face between voxels of the preview, so that the same preview voxels are
/// enclosed.
fn volume_index(face: f64, stride: u64) -> f64 {
    (face + 0.5) * stride as f64 - 0.5
}

#[cfg(test)]
mod tests {
    use super::volume_index;

    #[test]
    fn faces_hold_the_voxels_of_the_preview() {
        // Every fourth voxel: voxels 2 and 3 of the preview are voxels 8 to 15 of the volume.
        assert_eq!([volume_index(1.5, 4), volume_index(3.5, 4), volume_index(-0.5, 4)], [7.5, 15.5, -0.5]);
        assert_eq!(volume_index(6.5, 1), 6.5);
    }
}
