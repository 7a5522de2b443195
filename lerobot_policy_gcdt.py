from lerobot_gcdt import *
