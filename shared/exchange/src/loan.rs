//! A block of a publisher's shared memory that is being written in place. It is lent as it is: what an older message left lies in it until it
//! is written, so that a message costs one write and not two. Whoever writes a message writes all of it: [`hyst_messages::MessageMut`]
//! clears what lies between the sections, the writer fills the sections.

use crate::stream::LinkError;
use iceoryx2::prelude::ipc_threadsafe;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use std::mem::MaybeUninit;

type Variant = ipc_threadsafe::Service;

/// A block of shared memory that is being written. Dropped unsent, nobody ever sees it.
#[derive(Debug)]
pub struct Loan {
    sample: SampleMut<Variant, [u64], ()>,
}

impl Loan {
    /// A block as it is lent: any bytes.
    #[allow(unsafe_code)]
    pub(crate) fn as_lent(sample: SampleMutUninit<Variant, [MaybeUninit<u64>], ()>) -> Loan {
        // SAFETY: `assume_init` asks that every word holds a value. Any 64 bits are a u64, so what is to be shown is that the memory is
        // initialised at all. It is a chunk of the publisher's data segment, which the library maps (mmap, MAP_SHARED) from an object
        // that the kernel made full of zeros: memory from outside of Rust, with a value in each byte. Since then it was written through
        // this type, as u64 or as bytes of types without padding (bytemuck's NoUninit), and by no other process: readers map it
        // read-only. The library writes its own header in front of the payload and never writes `MaybeUninit::uninit()` into the payload.
        Loan { sample: unsafe { sample.assume_init() } }
    }
    /// The block.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(self.sample.payload())
    }
    /// The block, to write.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(self.sample.payload_mut())
    }
    /// Hands the block to the readers; from now on it is read-only for everyone.
    pub fn send(self) -> Result<usize, LinkError> {
        self.sample.send().map_err(|e| LinkError::Use { name: String::new(), action: "send", reason: format!("{e:?}") })
    }
}
