//! Memory for samples.

use bytemuck::Pod;
use memmap2::MmapMut;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// From this size on, memory is taken from the system in pages of its own.
const PAGES_FROM_BYTES: usize = 8 << 20;

/// Numbers in memory, one after the other; a slice in all but how its memory was had.
///
/// A volume's memory is taken once, written once from end to end and given back whole. In pages of 4 KB, most of the time
/// that a large uncompressed scan takes goes to the system handing them out; [`Buffer::zeroed`] asks for pages of 2 MB
/// where the system has them. What is made in any other way is a `Vec`.
pub struct Buffer<T>(Memory<T>);

enum Memory<T> {
    Heap(Vec<T>),
    Pages { map: MmapMut, count: usize, of: PhantomData<T> },
}

/// There is no room for what was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the system has no room for {count} samples of {sample_bytes} bytes")]
pub struct NoMemory {
    /// Samples asked for.
    pub count: usize,
    /// Bytes of each.
    pub sample_bytes: usize,
}

impl<T: Pod> Buffer<T> {
    /// So many zeros. Their pages are taken as they are written.
    ///
    /// # Errors
    /// If the system has no room for them.
    pub fn zeroed(count: usize) -> Result<Self, NoMemory> {
        let refused = NoMemory { count, sample_bytes: size_of::<T>() };
        let bytes = count.checked_mul(size_of::<T>()).ok_or(refused)?;
        // A system that does not hand out pages may have room on its heap.
        if let Some(map) = (bytes >= PAGES_FROM_BYTES).then(|| MmapMut::map_anon(bytes).ok()).flatten() {
            // A wish: without it the pages are smaller and all else is the same.
            #[cfg(target_os = "linux")]
            let _ = map.advise(memmap2::Advice::HugePage);
            return Ok(Self(Memory::Pages { map, count, of: PhantomData }));
        }
        let zeros = bytemuck::allocation::try_zeroed_vec(count).map_err(|()| refused)?;
        Ok(Self(Memory::Heap(zeros)))
    }

    /// Keeps the first `count` samples, or all if there are no more. What a `Vec` held beyond them is given back at once,
    /// what pages held when the buffer goes.
    pub fn truncate(&mut self, count: usize) {
        match &mut self.0 {
            Memory::Heap(samples) => {
                samples.truncate(count);
                samples.shrink_to_fit();
            }
            Memory::Pages { count: all, .. } => *all = count.min(*all),
        }
    }
}

impl<T: Pod> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            Memory::Heap(samples) => samples,
            // A page begins at a multiple of every sample's alignment.
            Memory::Pages { map, count, .. } => bytemuck::cast_slice(&map[..count * size_of::<T>()]),
        }
    }
}

impl<T: Pod> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Memory::Heap(samples) => samples,
            Memory::Pages { map, count, .. } => bytemuck::cast_slice_mut(&mut map[..*count * size_of::<T>()]),
        }
    }
}

impl<T> From<Vec<T>> for Buffer<T> {
    fn from(samples: Vec<T>) -> Self {
        Self(Memory::Heap(samples))
    }
}

impl<T> FromIterator<T> for Buffer<T> {
    fn from_iter<I: IntoIterator<Item = T>>(samples: I) -> Self {
        Self(Memory::Heap(samples.into_iter().collect()))
    }
}

impl<T: Pod> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        Self(Memory::Heap(self.to_vec()))
    }
}

impl<T: Pod + PartialEq> PartialEq for Buffer<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Pod + fmt::Debug> fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_in_pages_holds_what_a_vec_holds() {
        // Not a whole number of pages of any size.
        let count = PAGES_FROM_BYTES / 2 + 12_345;
        let mut pages = Buffer::<i16>::zeroed(count).unwrap();
        assert!(matches!(pages.0, Memory::Pages { .. }));
        assert!(pages.len() == count && pages.iter().all(|&s| s == 0));
        for (i, sample) in pages.iter_mut().enumerate() {
            *sample = (i % 30_011) as i16;
        }
        let heap: Buffer<i16> = (0..count).map(|i| (i % 30_011) as i16).collect();
        assert!(pages == heap && pages.clone() == heap);
        pages[count - 1] += 1;
        assert!(pages != heap);
        pages.truncate(7);
        assert_eq!(&pages[..], &heap[..7]);
    }

    /// What the system notes of the memory at an address: the line `VmFlags` of its map.
    #[cfg(target_os = "linux")]
    fn flags_of_memory_at(address: usize) -> String {
        let maps = std::fs::read_to_string("/proc/self/smaps").unwrap();
        let holds = |line: &str| {
            let (low, high) = line.split_whitespace().next()?.split_once('-')?;
            let [low, high] = [low, high].map(|hex| usize::from_str_radix(hex, 16));
            Some((low.ok()?..high.ok()?).contains(&address))
        };
        let mut lines = maps.lines().skip_while(|line| holds(line) != Some(true));
        lines.find_map(|line| line.strip_prefix("VmFlags:")).unwrap().to_owned()
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn large_pages_are_asked_for() {
        // A kernel that was built without them knows no such wish.
        if std::path::Path::new("/sys/kernel/mm/transparent_hugepage").exists() {
            let pages = Buffer::<u8>::zeroed(2 * PAGES_FROM_BYTES).unwrap();
            let flags = flags_of_memory_at(pages.as_ptr().addr() + PAGES_FROM_BYTES);
            assert!(flags.split_whitespace().any(|flag| flag == "hg"), "{flags}");
        }
    }

    #[test]
    fn truncating_never_grows() {
        let pages = Buffer::<u16>::zeroed(PAGES_FROM_BYTES).unwrap();
        for mut buffer in [pages, Buffer::from(vec![0u16; 9])] {
            for (asked, kept) in [(8, 8), (9, 8), (usize::MAX, 8), (0, 0), (1, 0)] {
                buffer.truncate(asked);
                assert_eq!(buffer.len(), kept);
            }
        }
    }

    #[test]
    fn small_buffers_and_empty_ones_are_on_the_heap() {
        for count in [0, 1, PAGES_FROM_BYTES / 4 - 1] {
            let buffer = Buffer::<f32>::zeroed(count).unwrap();
            assert!(matches!(buffer.0, Memory::Heap(_)) && buffer.len() == count);
        }
    }

    #[test]
    fn what_no_machine_has_is_refused() {
        assert_eq!(Buffer::<f32>::zeroed(usize::MAX / 2).unwrap_err().sample_bytes, 4);
        assert!(Buffer::<u8>::zeroed(usize::MAX / 2).is_err());
    }
}
