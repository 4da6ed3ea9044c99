"""Identity: do all photos show one person?"""
