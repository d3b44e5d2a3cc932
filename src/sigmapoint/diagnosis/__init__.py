"""Can an estimate be trusted?"""
