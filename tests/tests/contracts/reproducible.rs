//! Reproducible builds: the same input and options give the same bytes for any number of threads. All codecs decode to
//! the same voxels.

use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::{Lod, VoxelType};
use supervol_preprocess::BuildOptions;
use supervol_preprocess::verify::verify;
use supervol_sources::VolumeSource;
use supervol_sources::synthetic::Synthetic;
use supervol_tests::fields::{Built, Content, Field, built, options};

fn bytes_of(source: &dyn VolumeSource, options: &BuildOptions) -> Vec<u8> {
    std::fs::read(&built(source, options).path).expect("the container was just built")
}

/// Memory budgets from the least sufficient one, which gives many tiles, to a large one.
#[test]
fn threads_do_not_change_a_byte() {
    let field = Field::of(Content::Holes, [150, 90, 110], VoxelType::I16);
    for memory_bytes in [3 << 20, 6 << 20, 64 << 20] {
        let with_threads = |threads: usize| {
            let options = BuildOptions { threads, memory_bytes, ..options(16) };
            bytes_of(&field, &options)
        };
        let one = with_threads(1);
        for threads in [0, 2, 8] {
            assert!(with_threads(threads) == one, "{threads} threads, {memory_bytes} bytes of memory: other bytes");
        }
    }
}

#[test]
fn synthetic_volumes_build_the_same_twice() {
    for name in ["seismic", "vessels", "marschner-lobb"] {
        let source = || Synthetic::new(name, supervol_format::Dims([70, 65, 40]), None, 7).expect("the name is known");
        assert!(bytes_of(&source(), &options(32)) == bytes_of(&source(), &options(32)), "{name}");
    }
}

#[test]
fn all_codecs_decode_to_the_same_voxels() {
    // A uniform brick has no payload: every choice stores it as uniform.
    let codecs = Codec::ALL.into_iter().filter(|codec| *codec != Codec::Uniform);
    let choices: Vec<_> = [CodecChoice::Smallest].into_iter().chain(codecs.map(CodecChoice::Only)).collect();
    for content in [Content::Noise, Content::Shells, Content::Holes] {
        for voxel_type in VoxelType::ALL {
            let field = Field::of(content, [37, 33, 20], voxel_type);
            let containers: Vec<Built> =
                choices.iter().map(|&codec| built(&field, &BuildOptions { codec, ..options(16) })).collect();
            let smallest = containers[0].report.container_bytes;
            for built in &containers {
                verify(&built.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("{content:?} {voxel_type}: {e}"));
                assert!(smallest <= built.report.container_bytes + 64, "the smallest choice is not the smallest");
                assert_same_bricks(&containers[0], built);
            }
        }
    }
}

fn assert_same_bricks(a: &Built, b: &Built) {
    let pyramid = a.container.pyramid();
    for lod in 0..pyramid.levels().len() {
        for key in pyramid.keys_of(Lod(lod as u8)) {
            let read = |built: &Built| {
                let entry = built.container.entry(key).expect("a built container is whole");
                let voxels = built.container.read_brick(key, &entry).expect("a built container is whole");
                (entry.range, entry.range_beneath, entry.error, entry.has_holes, voxels)
            };
            assert!(read(a) == read(b), "{key} differs between codecs");
        }
    }
}
