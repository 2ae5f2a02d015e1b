//! The chip's EEPROM, one byte at a time and without waiting.

use avr_device::atmega328p::EEPROM;
use motorbench_core::storage::Eeprom;

/// 1024 bytes; a write takes 3.4 ms.
pub struct ChipEeprom(pub EEPROM);

impl Eeprom for ChipEeprom {
    fn read(&mut self, address: u16) -> u8 {
        while !self.ready() {}
        // SAFETY: the address is masked to the memory's size.
        self.0.eear().write(|w| unsafe { w.bits(address & 0x3ff) });
        self.0.eecr().modify(|_, w| w.eere().set_bit());
        self.0.eedr().read().bits()
    }

    fn ready(&mut self) -> bool {
        self.0.eecr().read().eepe().bit_is_clear()
    }

    fn write(&mut self, address: u16, byte: u8) {
        while !self.ready() {}
        // SAFETY: the address is masked to the memory's size; any byte is valid.
        unsafe {
            self.0.eear().write(|w| w.bits(address & 0x3ff));
            self.0.eedr().write(|w| w.bits(byte));
        }
        // The enable lasts four cycles: nothing may come between.
        avr_device::interrupt::free(|_| {
            self.0.eecr().modify(|_, w| w.eempe().set_bit());
            self.0.eecr().modify(|_, w| w.eepe().set_bit());
        });
    }
}
