from skinmap.touch.contacts.skin_geometry import SkinGeometry, measure_skin
from skinmap.touch.images.contact_image import ContactImageGeometry, image_geometry
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.simulator import simulate
from skinmap.touch.simulation.variety import Sensing

__all__ = [
    "ContactImageGeometry",
    "PreparedSkin",
    "Recording",
    "Sensing",
    "SkinGeometry",
    "image_geometry",
    "measure_skin",
    "simulate",
]
