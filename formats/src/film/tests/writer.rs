//! Films that are written in batches.

use super::*;

fn present(film: &FilmStore) -> usize {
    let all: Vec<_> = film.all_shards().collect();
    film.shards_bytes(&all).unwrap().iter().flatten().count()
}

fn stage(film: &FilmStore, writer: &FilmWriter<'_>, shards: usize) {
    for (output, band, shard) in film.all_shards().take(shards) {
        let pixels = film.shard_rect(output, shard).size().pixels();
        writer.commit(&film.encode_shard(output, band, shard, &vec![1.0; pixels]).unwrap()).unwrap();
    }
}

#[test]
fn shards_of_a_small_film_are_absent_until_their_batch_is_committed() {
    let dir = tempfile::tempdir().unwrap();
    let film = FilmStore::create(&dir.path().join("a.zarr"), spec(), provenance(), true).unwrap();
    let without = contents(&film);
    let writer = FilmWriter::new(&film);
    stage(&film, &writer, 5);
    assert_eq!(present(&film), 0);
    drop(writer);
    assert_eq!((contents(&film), film.group().sweep().unwrap()), (without, Sweep::default()));
    let writer = FilmWriter::new(&film);
    stage(&film, &writer, 5);
    writer.finish().unwrap();
    writer.finish().unwrap();
    assert_eq!(present(&film), 5);
    let alone = FilmStore::create(&dir.path().join("b.zarr"), spec(), provenance(), true).unwrap();
    for (output, band, shard) in alone.all_shards().take(5) {
        let pixels = alone.shard_rect(output, shard).size().pixels();
        alone.commit(&alone.encode_shard(output, band, shard, &vec![1.0; pixels]).unwrap()).unwrap();
    }
    assert_eq!(contents(&film), contents(&alone));
}

#[test]
fn shards_of_a_large_film_are_committed_one_by_one() {
    let dir = tempfile::tempdir().unwrap();
    for (width, is_batched) in [(1999, true), (2000, false)] {
        let spec = FilmSpec {
            shard: 64,
            chunk: 32,
            ..FilmSpec::full_film(Size::new(8000, width), vec![500.0], 2.0)
        };
        let film = FilmStore::create(&dir.path().join(width.to_string()), spec, provenance(), false).unwrap();
        let writer = FilmWriter::new(&film);
        stage(&film, &writer, 3);
        assert_eq!(present(&film), if is_batched { 0 } else { 3 }, "{width}");
    }
}

#[test]
fn batch_of_a_film_that_was_replaced_is_an_error_and_leaves_the_new_film_unchanged() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = FilmStore::create(&path, spec(), provenance(), true).unwrap();
    let writer = FilmWriter::new(&film);
    stage(&film, &writer, 2);
    FilmStore::remove(&path).unwrap();
    let new = FilmStore::create(&path, spec(), provenance(), true).unwrap();
    let expected = contents(&new);
    let e = writer.finish().unwrap_err();
    assert!(matches!(e, GroupError::Recreated { .. }), "{e}");
    assert_eq!(contents(&new), expected);
}
